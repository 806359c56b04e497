// The page over the API: asks, watches, shows. All text from the server is put in as text.
"use strict";
(() => {
  const $ = (id) => document.getElementById(id);
  const EVERY = 1000;
  let about = null, upload = null, shown = "", shownAsset = "", drawn = "";

  async function call(path, options) {
    let answer;
    try {
      answer = await fetch(path, options);
    } catch (error) {
      throw new Error("the server does not answer: start it again; nothing that was asked for is lost");
    }
    const body = answer.headers.get("content-type")?.startsWith("application/json") ? await answer.json() : {};
    if (!answer.ok) throw new Error(body.error || `the server said ${answer.status}`);
    return body;
  }
  const post = (path, value) => call(path, {
    method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(value || {}),
  });
  function complain(error) {
    $("error").textContent = error ? error.message : "";
    $("error").hidden = !error;
  }
  function time(seconds) {
    const whole = Math.round(seconds);
    return whole < 100 ? `${whole} s` : `${Math.floor(whole / 60)} min ${String(whole % 60).padStart(2, "0")} s`;
  }

  // A file: what it can be used for follows from its ending.
  async function take(file) {
    complain(null);
    drop();
    if (!file) return;
    const ending = (file.name.match(/\.[^.]+$/) || [""])[0].toLowerCase();
    if (![...about.meshes, ...about.drawings].includes(ending)) {
      complain(new Error(`${file.name} is no mesh and no drawing: give ${[...about.meshes, ...about.drawings].join(" ")}`));
      return;
    }
    if (file.size > about.largest_upload) {
      complain(new Error(`${file.name} is larger than ${about.largest_upload >> 20} MB`));
      return;
    }
    $("file-name").textContent = `${file.name}: sending …`;
    $("chosen").hidden = false;
    const mine = upload = { ready: null };
    mine.ready = call(`/api/uploads?name=${encodeURIComponent(file.name)}`, {
      method: "POST", headers: { "content-type": "application/octet-stream" }, body: file,
    });
    try {
      const { kind } = await mine.ready;
      if (upload !== mine) return;
      $("file-name").textContent = file.name;
      $("paint").hidden = kind === "drawing";
      if (kind === "drawing") document.querySelector("[name=use][value=sketch]").checked = true;
      showStrictness();
    } catch (error) {
      if (upload === mine) drop();
      complain(error);
    }
  }
  function drop() {
    upload = null;
    $("chosen").hidden = true;
  }
  const use = () => document.querySelector("[name=use]:checked").value;
  const showStrictness = () => { $("strict").hidden = use() === "mesh"; };
  $("use").addEventListener("change", showStrictness);
  $("file").addEventListener("change", () => take($("file").files[0]));
  $("remove").addEventListener("click", () => { $("file").value = ""; drop(); $("file").focus(); });
  for (const name of ["dragenter", "dragover"]) {
    $("drop").addEventListener(name, (event) => { event.preventDefault(); $("drop").classList.add("over"); });
  }
  for (const name of ["dragleave", "drop"]) {
    $("drop").addEventListener(name, () => $("drop").classList.remove("over"));
  }
  for (const name of ["dragover", "drop"]) {
    document.addEventListener(name, (event) => event.preventDefault());  // a file beside the field does not open
  }
  $("drop").addEventListener("drop", (event) => {
    event.preventDefault();
    $("file").value = "";
    take(event.dataTransfer.files[0]);
  });

  $("ask").addEventListener("submit", async (event) => {
    event.preventDefault();
    const button = document.querySelector("button.go");
    button.disabled = true;
    complain(null);
    try {
      const given = {
        prompt: $("prompt").value, negative: $("negative").value, seed: $("seed").value, model: $("model").value,
        quality: document.querySelector("[name=quality]:checked").value, refine: $("refine").checked,
      };
      if (upload) {
        given[use()] = (await upload.ready).id;
        if (use() === "sketch") given.sigma_s = $("sigma").value;
      }
      const made = await post("/api/jobs", given);
      location.hash = made.name;
      await refresh();
      $("shown-title").focus();
    } catch (error) {
      complain(error);
    } finally {
      button.disabled = false;
    }
  });
  for (const act of ["cancel", "resume"]) {
    $(act).addEventListener("click", async () => {
      try {
        await post(`/api/jobs/${shown}/${act}`);
        await refresh();
      } catch (error) {
        complain(error);
      }
    });
  }

  // What is shown: a job that was asked for, or a finished run of the folder.
  function show(job) {
    $("shown").hidden = !job;
    if (!job) return;
    const running = job.state === "running";
    $("shown-title").textContent = job.job.prompt;
    $("facts").textContent = [job.job.quality, `seed ${job.job.seed}`, job.job.negative && `not: ${job.job.negative}`,
      job.job.mesh && "painted mesh", job.job.sketch && "from a sketch"].filter(Boolean).join(" · ");
    const states = {
      queued: job.before ? `Waiting: ${job.before} before it.` : "Waiting: it is next.",
      running: "Being made.", stopped: "Stopped. It goes on from where it was.", done: "Done.",
      failed: `It failed: ${job.reason}`,
    };
    if ($("state").textContent !== states[job.state]) $("state").textContent = states[job.state];
    $("running").hidden = !running;
    if (running && job.progress) {
      const { part, left_text: left, stage, step } = job.progress;
      $("bar").value = part;
      $("bar").textContent = `${Math.round(part * 100)} %`;
      $("told").textContent = `${Math.round(part * 100)} %, ${left}${stage ? `; ${stage}${step ? `: ${step}` : ""}` : ""}`;
    }
    const warnings = (job.progress?.warnings || []).map((text) => {
      const line = document.createElement("p");
      line.className = "warning";
      line.textContent = text;
      return line;
    });
    if ($("notes").childElementCount !== warnings.length) $("notes").replaceChildren(...warnings);
    const growing = $("growing");
    growing.onerror = () => { growing.hidden = true; };
    growing.hidden = !job.picture;
    if (job.picture && growing.getAttribute("src") !== job.picture) growing.src = job.picture;
    growing.alt = job.picture ? `${job.job.prompt}, as far as it has grown` : "";
    $("cancel").hidden = !["queued", "running"].includes(job.state);
    $("resume").hidden = !["stopped", "failed"].includes(job.state);
    const done = job.state === "done";
    $("viewer").hidden = $("downloads").hidden = !done;
    if (done && shownAsset !== job.name) open(job);
    if (!done) shownAsset = "";
  }
  async function open(job) {
    shownAsset = job.name;
    const list = (job.files || []).map((file) => {
      const item = document.createElement("li"), link = document.createElement("a");
      link.href = `/runs/${job.name}/${file.name}${file.name === "report.html" ? "" : "?download"}`;
      link.textContent = file.bytes ? `${file.name} (${file.bytes >= 1e5 ? `${(file.bytes / 1e6).toFixed(1)} MB` : `${Math.ceil(file.bytes / 1e3)} kB`})` : file.name;
      item.append(link);
      return item;
    });
    $("downloads").querySelector("ul").replaceChildren(...list);
    const answer = await fetch(`/runs/${job.name}/asset.glb`);
    if (answer.ok && shownAsset === job.name) showAsset($("viewer"), await answer.arrayBuffer());
  }

  function tile(name, prompt, picture, whole, note) {
    const item = document.createElement("li"), button = document.createElement("button");
    const frame = document.createElement("span"), text = document.createElement("span");
    button.type = "button";
    frame.className = whole ? "picture whole" : "picture";
    text.className = "text";
    text.textContent = note ? `${prompt} (${note})` : prompt;
    if (picture) {
      const image = document.createElement("img");
      image.src = picture;
      image.alt = "";
      image.loading = "lazy";
      frame.append(image);
    }
    button.append(frame, text);
    button.addEventListener("click", () => {
      location.hash = name;
      refresh().then(() => { $("shown").scrollIntoView({ block: "start" }); $("shown-title").focus({ preventScroll: true }); });
    });
    item.append(button);
    return item;
  }
  function list(jobs, runs) {
    const notes = { queued: "waiting", running: "being made", stopped: "stopped", failed: "failed" };
    const open = jobs.filter((job) => job.state !== "done");
    const key = JSON.stringify([open.map((j) => [j.name, j.state, j.picture]), runs.map((r) => r.name)]);
    if (key === drawn) return;
    drawn = key;
    const focused = document.activeElement?.closest?.("#all li");
    const place = focused ? [...$("all").children].indexOf(focused) : -1;
    const tiles = [
      ...open.map((job) => tile(job.name, job.job.prompt, job.picture, true, notes[job.state])),
      ...runs.map((run) => tile(run.name, run.job.prompt, `/runs/${run.name}/preview.png`, false, "")),
    ];
    $("all").replaceChildren(...tiles);
    $("none").hidden = tiles.length > 0;
    if (place >= 0) $("all").children[place]?.querySelector("button").focus();
  }

  async function refresh() {
    const { jobs, runs } = await call("/api/jobs");
    const wanted = decodeURIComponent(location.hash.slice(1));
    if (wanted && wanted !== shown && !jobs.concat(runs).some((one) => one.name === wanted)) return list(jobs, runs);
    shown = wanted;
    let job = jobs.find((one) => one.name === wanted);
    const run = runs.find((one) => one.name === wanted);
    if (!job && run) {
      // Made by the command line: its files are those that every run has.
      const files = ["asset.glb", "asset.obj", "preview.png", "turntable.mp4", "report.html", "job.yaml", "manifest.json"];
      job = { name: run.name, state: "done", job: run.job, files: files.map((name) => ({ name })) };
    }
    show(job);
    list(jobs, runs);
  }
  async function watch() {
    try {
      if (!document.hidden) {
        await refresh();
        if ($("error").dataset.lost) { complain(null); delete $("error").dataset.lost; }
      }
    } catch (error) {
      complain(error);
      $("error").dataset.lost = "1";
    }
    setTimeout(watch, EVERY);
  }
  addEventListener("hashchange", () => refresh().catch(complain));

  call("/api").then((told) => {
    about = told;
    $("file").accept = [...told.meshes, ...told.drawings].join(",");
    for (const [quality, seconds] of Object.entries(told.quality_seconds)) {
      document.querySelector(`[data-quality="${quality}"]`).textContent = `about ${time(seconds)}`;
    }
    for (const name of told.models) $("model").add(new Option(name, name, name === told.default_model, name === told.default_model));
  }).catch(complain).finally(watch);
})();
