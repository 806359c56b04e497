"""From words on a command line to a verb and its variables: what make passes in the environment.

`latent-nerf run "a red armchair" --seed 3` and `latent-nerf run PROMPT="a red armchair" SEED=3` are the same.
"""

import argparse
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import NoReturn

from pipeline.cli.variables import Verb, nearest, verbs
from pipeline.errors import InputError
from pipeline.options.schema import short

POSITIONAL = {"run": "PROMPT", "plan": "PROMPT", "verify": "RUN", "sweep": "JOBS", "export": "CHECKPOINT"}
"""The variable that a verb takes without its name."""
SWITCHES = frozenset({"REFINE", "UNLIT", "VERIFY"})
"""Variables that are 1 or 0: on the command line the option alone says 1."""
SHELLS = ("bash", "zsh", "tcsh")
EXAMPLES = {
    "run": """
      latent-nerf run "a red armchair"
      latent-nerf run "a blue mug" --seed 3 --quality draft
      latent-nerf run "a blue house" --sketch house.obj --sigma-s 0.05
      latent-nerf run "a brown teddy bear" --mesh teddy_bear.obj
      latent-nerf run --job runs/latest/job.yaml

    The last two lines it prints are the paths of asset.glb and report.html. The same command again does
    nothing if nothing changed, and goes on where it stopped if it was interrupted. Exit status: 0, 2 for what
    you can mend, 1 for a fault of the program.""",
    "plan": """
      latent-nerf plan "a red armchair" --quality high""",
    "verify": """
      latent-nerf verify runs/latest""",
    "serve": """
      latent-nerf serve
      latent-nerf serve --port 9000 --out /data/chairs
      latent-nerf serve --host 0.0.0.0        asks visitors for the token that it prints

    Needs the extra: pip install "latent-nerf-onnx[serve]". Ctrl-C ends it; what was asked for goes on with
    the next start.""",
    "sweep": """
      latent-nerf sweep prompts.txt           a prompt a line
      latent-nerf sweep sweep.yaml --profile slurm

    sweep.yaml:
      prompt: [a red armchair, a blue armchair]
      seed: [0, 1, 2]
      quality: draft
      clean: {faces: [5000, 20000]}

    Every list is varied: this is twelve runs.""",
    "export": """
      latent-nerf export path/to/checkpoint --name my-model
      latent-nerf run "a red armchair" --model my-model

    Needs the extra: pip install "latent-nerf-onnx[export]".""",
    "completion": """
      latent-nerf completion bash > ~/.local/share/bash-completion/completions/latent-nerf
      latent-nerf completion zsh > "${fpath[1]}/_latent-nerf" """,
}


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, as everything here does."""

    def error(self, message: str) -> NoReturn:
        """Raise InputError."""
        raise InputError(f"{message}; see {self.prog} --help")


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the console script: a subcommand a verb, an option a variable."""
    parser = _Parser(
        prog="latent-nerf",
        description="A text becomes a textured 3D mesh, on the CPU.",
        epilog="latent-nerf VERB --help says what a verb takes.",
        allow_abbrev=False,
    )
    # Not required: without a verb the help is more use than an error.
    commands = parser.add_subparsers(dest="verb", metavar="VERB", title="verbs", parser_class=_Parser)
    for verb in verbs().values():
        examples = textwrap.dedent(EXAMPLES.get(verb.name, "").strip("\n").rstrip())
        sub = commands.add_parser(
            verb.name,
            help=_escaped(verb.meaning),
            description=f"{verb.meaning}.",
            epilog=f"examples:\n{examples}" if examples else None,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        _add_variables(sub, verb)
        if verb.name == "completion":
            sub.add_argument("shell", metavar="SHELL", choices=SHELLS, help="bash, zsh or tcsh")
    return parser


def _add_variables(parser: argparse.ArgumentParser, verb: Verb) -> None:
    help = f"{POSITIONAL[verb.name]} without its name" if verb.name in POSITIONAL else argparse.SUPPRESS
    parser.add_argument("given", nargs="*", metavar=POSITIONAL.get(verb.name, "NAME=value"), help=help)
    for variable in verb.variables:
        parser.add_argument(
            variable.option,
            dest=variable.name,
            metavar=variable.example if " " not in variable.example else variable.name,
            help=_escaped(variable.meaning),
            nargs="?" if variable.name in SWITCHES else None,
            const="1" if variable.name in SWITCHES else None,
        )


def _escaped(text: str) -> str:
    return text.replace("%", "%%")


def parse(words: Sequence[str]) -> tuple[str, dict[str, str]]:
    """Return the verb and the variables that words say; no verb: "".

    Raises:
        InputError: a verb, an option or a variable that there is not, with the one that may be meant; a value
            said twice, or missing.
        SystemExit: help was asked for, and printed.
    """
    known = verbs()
    if words and words[0] not in known and not words[0].startswith("-"):
        if words[0] == "help":
            return parse([*words[1:2], "--help"])
        raise InputError(f"{words[0]!r} is no verb{nearest(words[0], known) or _list('there are', known)}")
    found, unknown = make_parser().parse_known_args(words)
    if not found.verb:
        return "", {}
    verb = known[found.verb]
    if unknown:
        options = [v.option for v in verb.variables]
        name = unknown[0].partition("=")[0]
        hint = nearest(name, options) or _list("it takes", options)
        raise InputError(f"{name} is no option of {verb.name}{hint}")
    given = {v.name: getattr(found, v.name) for v in verb.variables if getattr(found, v.name) is not None}
    if verb.name == "completion":
        given["SHELL"] = found.shell
    for word in found.given:
        name, value = _assigned(word, verb)
        if name in given:
            mend = "put it in quotes" if name == "PROMPT" else "leave one out"
            raise InputError(f"{name} is given twice, {short(given[name])} and {short(value)}: {mend}")
        given[name] = value
    return verb.name, given


def _list(head: str, words: Iterable[str]) -> str:
    return f"; {head}: {', '.join(words) or 'none'}"


def _assigned(word: str, verb: Verb) -> tuple[str, str]:
    """Return the variable and the value of a word without an option: NAME=value, or the value alone."""
    names = [v.name for v in verb.variables]
    match = re.fullmatch(r"([A-Z][A-Z_]+)=(.*)", word, flags=re.DOTALL)
    if match:
        if match[1] not in names:
            hint = nearest(match[1], names) or _list("it takes", names)
            raise InputError(f"{match[1]} is no variable of {verb.name}{hint}")
        return match[1], match[2]
    if verb.name not in POSITIONAL:
        raise InputError(
            f"{verb.name} takes nothing of the kind of {word!r}; see latent-nerf {verb.name} --help"
        )
    return POSITIONAL[verb.name], word


def variables_of_make(verb: str, environment: Mapping[str, str]) -> dict[str, str]:
    """Return what make passes to a verb."""
    names = [v.name for v in verbs()[verb].variables]
    return {name: environment[name] for name in names if environment.get(name)}
