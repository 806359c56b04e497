"""Several seeds on a tiny bundle: the one that goes on is what its seed alone would have been."""

import dataclasses
from pathlib import Path

import pytest

from pipeline.diffusion.agreement import agreement
from pipeline.options.nerf import Contest
from pipeline.run.stage import Context
from pipeline.stages import contest, train_nerf
from tests.stages.test_train_nerf import make_context
from tests.tiny_bundle import write_tiny_bundle

STEPS = 12


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_bundle(tmp_path_factory.mktemp("models") / "tiny", latent_size=12)


def to_contest(run: Path, bundle: Path, seeds: int) -> Context:
    made = make_context(run, bundle, steps=STEPS, checkpoint_every=2)
    job = dataclasses.replace(made.job, seeds=seeds, contest=Contest(share=0.5, views=4))
    outputs = {"state": run / "contest.npz", "sheet": run / "contest.png"}
    return Context(job, made.inputs, outputs, made.scratch)


def test_the_best_seed_goes_on_as_if_it_were_alone(
    bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    context = to_contest(tmp_path / "a", bundle, 3)
    contest.main(context)
    scores = context.metrics["scores"]
    assert list(scores) == ["3", "4", "5"]
    best = context.metrics["chosen_seed"]
    assert scores[str(best)]["score"] == max(row["score"] for row in scores.values())

    killed = to_contest(tmp_path / "killed", bundle, 3)
    real = agreement

    def stop(*arguments, **named):
        if (killed.scratch / "4").is_dir():
            raise KeyboardInterrupt
        return real(*arguments, **named)

    monkeypatch.setattr(contest, "agreement", stop)
    with pytest.raises(KeyboardInterrupt):
        contest.main(killed)
    monkeypatch.undo()
    again = to_contest(tmp_path / "killed", bundle, 3)
    contest.main(again)
    for name in ("state", "sheet"):
        assert again.outputs[name].read_bytes() == context.outputs[name].read_bytes()

    goes_on = make_context(tmp_path / "on", bundle, steps=STEPS)
    goes_on.inputs["contest"] = context.outputs["state"]
    train_nerf.main(goes_on)
    assert goes_on.metrics["resumed_at"] == STEPS // 2
    alone = make_context(tmp_path / "alone", bundle, steps=STEPS)
    alone = dataclasses.replace(alone, job=dataclasses.replace(alone.job, seed=best))
    train_nerf.main(alone)
    assert goes_on.outputs["scene"].read_bytes() == alone.outputs["scene"].read_bytes()
