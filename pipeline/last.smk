# The end of both chains: what is made of a finished asset, and what is said of it.
if "formats" in STAGES:
    rule formats:
        input: glb="asset.glb"
        output:
            **{f"as_{kind}": update(f"asset.{kind}") for kind in config["formats"].split("+")},
            entry=update("stages/formats.json")
        params: files=files()
        threads: config["threads"]
        shell: WARM

rule report:
    input:
        glb="asset.glb", preview="preview.png", turntable="turntable.mp4",
        **({"contest_sheet": "contest.png"} if "contest" in STAGES else {}),
        **{stage: f"stages/{stage}.json" for stage in STAGES}
    output: report=update("report.html"), manifest=update("manifest.json"), entry=update("stages/report.json")
    params: files=files()
    threads: config["threads"]
    shell: WARM
