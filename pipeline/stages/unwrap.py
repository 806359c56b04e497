"""Stage `unwrap`: texture coordinates."""

from pipeline.mesh.mesh import read_ply, write_obj
from pipeline.mesh.unwrap import unwrap_mesh
from pipeline.run.stage import Context, execute


def main(context: Context) -> None:
    """Read the clean mesh; write it with texture coordinates."""
    options = context.job.unwrap
    mesh, metrics = unwrap_mesh(read_ply(context.inputs["mesh"]), options.resolution, options.padding)
    context.metrics.update(metrics)
    if metrics["padding"] < options.padding:
        context.metrics["warnings"] = [
            f"{metrics['charts']} charts leave room for {metrics['padding']} texels of padding instead of "
            f"{options.padding}: seams may show from afar; raise unwrap.resolution"
        ]
    write_obj(context.outputs["mesh"], mesh)


if __name__ == "__main__":
    execute("unwrap", main)
