"""What a run left out because its scene did not need it, in sentences."""

from collections.abc import Sequence
from typing import Any

from pipeline.run.chain import PAINT, STAGES, TEXT


def unneeded(entries: Sequence[dict[str, Any]]) -> list[str]:
    """Return a line for every kind of work that was saved, the stage's name first.

    `entries`: those of the run's stages, as in its manifest. What can be left out is measured by `make bench
    ONLY=skip`.
    """
    lines = [f"{entry['stage']}: {line}" for entry in entries for line in _of_stage(entry)]
    ran = {entry["stage"] for entry in entries}
    chain = next((chain for chain in (TEXT, PAINT) if ran <= {stage.name for stage in chain}), ())
    if absent := [stage.optional for stage in chain if stage.optional and stage.name not in ran]:
        lines.append(f"not asked for, so neither run nor loaded: {' and '.join(absent)}")
    if reused := [entry["stage"] for entry in entries if entry.get("reused_from")]:
        lines.append(f"taken from another run: {', '.join(reused)}")
    return lines


def _of_stage(entry: dict[str, Any]) -> list[str]:
    metrics, lines = entry["metrics"], []
    if metrics.get("skipped_samples"):
        told = ", ".join(
            f"{100 * share:.1f} % {where}" for where, share in metrics["skipped_samples"].items()
        )
        lines.append(f"samples of its rays: {told}")
    if metrics.get("skipped_steps"):
        skipped = metrics["skipped_steps"]
        lines.append(f"{skipped} of {metrics['steps'] + skipped} steps, since the scene had converged")
    if metrics.get("unjudged_share"):
        lines.append(
            f"the sketch's distance in the {100 * metrics['unjudged_share']:.1f} % of the box nearest it"
        )
    if metrics.get("unseen_colours"):
        every = metrics["colours"] + metrics["unseen_colours"]
        lines.append(f"{metrics['unseen_colours']} of {every} colours, which no face uses or no view sees")
    if metrics.get("uv") == "the file's":
        lines.append("unwrapping: the file's texture coordinates are good")
    asked = entry.get("options", {}).get(STAGES[entry["stage"]].training, {})
    if asked.get("guidance_scale") == asked.get("guidance_scale_end") == 1:
        lines.append("the denoiser's pass without the text, since guidance is 1")
    return lines
