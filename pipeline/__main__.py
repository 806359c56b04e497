"""The front door: behind make (``python -m pipeline verb``) and of the console script (``latent-nerf verb``).

Make passes everything in the environment (PROMPT, SEED and the others of help.txt), so that no shell ever
reads what a user wrote; the console script takes the same as options. Exit status: 0, 2 for what the user can
mend, 1 for a fault of the program.
"""

import importlib.util
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import NoReturn

from pipeline.cli.arguments import make_parser, parse, variables_of_make
from pipeline.cli.variables import verbs
from pipeline.documents import whole_number
from pipeline.errors import InputError, one_line
from pipeline.files import say_refusal, write_text
from pipeline.options import job as jobs
from pipeline.options.hand_over import resolve_all
from pipeline.options.schema import describe, short
from pipeline.progress import duration
from pipeline.run import engine
from pipeline.run.costs import Cost
from pipeline.run.failures import memory_limit
from pipeline.run.folder import check_out
from pipeline.run.sequence import plan_runs, run_jobs
from pipeline.run.snakefiles import cache_folder
from pipeline.run.verify import verify


def main(arguments: list[str], environment: Mapping[str, str]) -> int:
    """Carry out one command, with make's variables from the environment, and return the exit status."""
    try:
        verb, given = parse(arguments)
        if not verb:
            make_parser().print_help()
            return 0
        with cache_folder():
            status = COMMANDS[verb]({**variables_of_make(verb, environment), **given})
        sys.stdout.flush()
        return status
    except MemoryError:
        print(
            f"error: out of memory{memory_limit()}: close other programs, or lower QUALITY", file=sys.stderr
        )
        return 2
    except BrokenPipeError:  # the reader of the output, head for one, has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (InputError, OSError) as error:
        say_refusal(error)
        return 2
    except engine.StageFailure as error:
        print(f"error: {one_line(str(error))}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("stopped; the same command goes on from here", file=sys.stderr)
        return 130


def _run(environment: Mapping[str, str]) -> int:
    out, profile = check_out(environment.get("OUT") or "runs"), environment.get("PROFILE") or "local"
    run = run_jobs(resolve_all(environment, out), out, _threads(environment), profile)
    for name in engine.RESULTS:
        print(run / name)
    return 0


def _plan(environment: Mapping[str, str]) -> int:
    out, profile = check_out(environment.get("OUT") or "runs"), environment.get("PROFILE") or "local"
    _threads(environment)
    costs: list[Cost] = []
    chain = resolve_all(environment, out)
    for job, planned in zip(chain, plan_runs(chain, out, profile), strict=True):
        print(f"{out / jobs.run_name(job)}" + (f", with {job.model}" if len(chain) > 1 else ""))
        print(f"{'stage':<13} {'':<10} {'time':>9} {'memory':>8}  why")
        for step, cost in planned:
            time, memory = (
                (duration(cost.seconds), f"{cost.memory_mb:.0f} MB") if step.verdict == "run" else ("", "")
            )
            print(f"{step.stage:<13} {step.verdict:<10} {time:>9} {memory:>8}  {step.reason}".rstrip())
        own = [cost for step, cost in planned if step.verdict == "run"]
        if own and len(chain) > 1:
            print(f"about {duration(sum(cost.seconds for cost in own))} with {job.model}\n")
        costs += own
    if costs:
        total, peak = sum(cost.seconds for cost in costs), max(cost.memory_mb for cost in costs)
        print(
            f"about {duration(total)} and {peak:.0f} MB of memory on this machine; nothing was run or written"
        )
    else:
        print("nothing would run")
    return 0


def _verify(environment: Mapping[str, str]) -> int:
    if not environment.get("RUN"):
        raise InputError(
            "RUN is empty: name the folder of a finished run, for example make verify RUN=runs/latest"
        )
    run = Path(environment["RUN"])
    count, faults = verify(run)
    if faults:
        raise InputError(
            f"{run}: {len(faults)} of {count} files are not as made: {', '.join(faults)}; "
            "the command that made the run mends them"
        )
    print(f"{run}: all {count} files are as made")
    return 0


def _options(environment: Mapping[str, str]) -> int:
    job = jobs.resolve({"PROMPT": "a red armchair", "MODEL": environment.get("MODEL", "")})
    print(describe(jobs.Job, job))
    return 0


def _models(environment: Mapping[str, str]) -> int:
    from pipeline.cli.models import list_models

    faults = list_models(environment.get("VERIFY", "0") not in ("", "0"), print)
    if faults:
        raise InputError("; ".join(faults))
    return 0


def _doctor(environment: Mapping[str, str]) -> int:
    from pipeline.cli import doctor

    threads = _threads(environment)
    wrong = doctor.report(doctor.checks(check_out(environment.get("OUT") or "runs"), threads), print)
    wrong += doctor.report(doctor.model_findings(), print)
    wrong += doctor.report(iter([doctor.self_test(threads)]), print)
    print("nothing is wrong" if not wrong else f"{wrong} wrong, with what to do after the arrows")
    return 2 if wrong else 0


def _serve(environment: Mapping[str, str]) -> int:
    if importlib.util.find_spec("starlette") is None or importlib.util.find_spec("uvicorn") is None:
        raise InputError(
            'this needs the extra serve, which is not installed: pip install "latent-nerf-onnx[serve]"'
        )
    from pipeline.server.serve import serve

    text = environment.get("PORT") or "8008"
    port = whole_number(text)
    if port is None or port > 65_535:
        raise InputError(f"PORT is {short(text)}, expected a whole number from 0 to 65535")
    out, threads = check_out(environment.get("OUT") or "runs"), _threads(environment)
    host, profile = environment.get("HOST") or "127.0.0.1", environment.get("PROFILE") or "local"
    serve(out, host, port, threads, profile, lambda line: print(line, flush=True))
    return 0


def _sweep(environment: Mapping[str, str]) -> int:
    from pipeline.options.sweep import read_sweep
    from pipeline.report.contact_sheet import write_overview
    from pipeline.run.sweep import run_sweep, sweep_folder

    if not environment.get("JOBS"):
        raise InputError("JOBS is empty: name a file with prompts, for example make sweep JOBS=sweep.yaml")
    path, out = Path(environment["JOBS"]), check_out(environment.get("OUT") or "runs")
    threads, profile = _threads(environment), environment.get("PROFILE") or "local"
    sweep = read_sweep(path)
    folder = sweep_folder(out, sweep.jobs, path.stem)
    outcomes = run_sweep(sweep.jobs, out, folder, threads, profile)
    rows = [(one.run, sweep.values(one.job), one.reason) for one in outcomes]
    for file in write_overview(folder, path.stem, rows):
        print(file)
    failed = [one for one in outcomes if one.reason]
    if failed:
        raise InputError(f"{len(failed)} of {len(outcomes)} were not made; the first: {failed[0].reason}")
    return 0


def _gallery(environment: Mapping[str, str]) -> int:
    from pipeline.report import gallery

    out = check_out(environment.get("OUT") or "runs")
    runs = gallery.find_runs(out)
    if not runs:
        raise InputError(f"{out} holds no finished run: make one first, or say OUT=folder")
    write_text(out / gallery.NAME, gallery.render(runs))
    print(out / gallery.NAME)
    return 0


def _completion(environment: Mapping[str, str]) -> int:
    from pipeline.cli.completion import script

    print(script(make_parser(), environment["SHELL"]))
    return 0


def _export(environment: Mapping[str, str]) -> int:
    return _with_extra("export", "diffusers", environment)


def _learn_token(environment: Mapping[str, str]) -> int:
    return _with_extra("export.everyday_objects.train.learn_token", "diffusers", environment)


def _with_extra(module: str, needed: str, environment: Mapping[str, str]) -> int:
    """Run a module that lies beside this package and needs an extra, in a process of its own."""
    if importlib.util.find_spec(needed) is None:
        raise InputError(
            'this needs the extra export, which is not installed: pip install "latent-nerf-onnx[export]"'
        )
    ours = {variable.name for verb in verbs().values() for variable in verb.variables}
    others = {name: value for name, value in os.environ.items() if name not in ours}
    return subprocess.call([sys.executable, "-m", module], env={**others, **environment})


def _threads(environment: Mapping[str, str]) -> int:
    """Return the threads of a stage: all cores this process may use, unless THREADS says otherwise."""
    text = environment.get("THREADS", "")
    if not text:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if not 1 <= (threads := whole_number(text) or 0) <= 1024:
        raise InputError(f"THREADS is {short(text)}, expected a whole number from 1 to 1024")
    return threads


COMMANDS = {
    "run": _run,
    "plan": _plan,
    "verify": _verify,
    "options": _options,
    "models": _models,
    "doctor": _doctor,
    "serve": _serve,
    "sweep": _sweep,
    "gallery": _gallery,
    "export": _export,
    "learn-token": _learn_token,
    "completion": _completion,
}


def console() -> NoReturn:
    """Be the program `latent-nerf`: what it is told, it is told on its command line alone."""
    sys.stdout.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]  # a terminal of LANG=C
    _end(main(sys.argv[1:], {}))


def _end(status: int) -> NoReturn:
    sys.stderr.flush()
    os._exit(status)  # the modules of Snakemake take a third of a second to be taken down


if __name__ == "__main__":
    sys.stdout.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]  # a terminal of LANG=C
    _end(main(sys.argv[1:], os.environ))
