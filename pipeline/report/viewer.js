// Shows an asset: turned with the mouse, a finger or the arrow keys, nearer with the wheel, a pinch or + and -.
// showAsset(host, bytes) fills an element with it; it needs three.js with its loader of glTF (THREE). Without WebGL it
// says so in a line and returns null.
"use strict";

function showAsset(host, bytes) {
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  const stage = document.createElement("div");
  stage.className = "stage";
  stage.tabIndex = 0;
  stage.setAttribute("role", "application");
  stage.setAttribute("aria-label", "3D view of the asset. Arrow keys turn it, plus and minus move nearer and away, 0 goes back.");
  const bar = document.createElement("div");
  bar.className = "viewer-bar";
  const status = document.createElement("span");
  status.className = "dim";
  status.setAttribute("role", "status");

  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true, preserveDrawingBuffer: true });
  } catch (error) {
    // Without the stage: it would stay an empty box.
    status.textContent = "This browser has no WebGL: see the pictures instead.";
    bar.append(status);
    host.replaceChildren(bar);
    return null;
  }
  host.replaceChildren(stage, bar);
  renderer.outputEncoding = THREE.sRGBEncoding;
  stage.append(renderer.domElement);
  const scene = new THREE.Scene();
  scene.add(new THREE.HemisphereLight(0xffffff, 0x8c8c96, 0.85));
  const lamp = new THREE.DirectionalLight(0xffffff, 0.9);
  const fill = new THREE.DirectionalLight(0xffffff, 0.3);
  scene.add(lamp, fill);
  const camera = new THREE.PerspectiveCamera(35, 1, 0.01, 1000);
  const centre = new THREE.Vector3();
  const clay = new THREE.MeshStandardMaterial({ color: 0xb8b4ae, roughness: 0.9, metalness: 0, side: THREE.DoubleSide });
  const FRONT = { azimuth: 0.5, elevation: 0.3, distance: 1 };
  let view = { ...FRONT };
  let radius = 1, model = null, turning = false, wanted = false, last = 0;
  const own = new Map();

  function draw(now) {
    wanted = false;
    if (turning) {
      view.azimuth += Math.min((now - last) / 1000, 0.1) * 0.6;
      last = now;
    }
    const reach = radius / Math.sin(camera.fov * Math.PI / 360) * 0.95 * view.distance * Math.max(1, 1 / camera.aspect);
    const flat = Math.cos(view.elevation) * reach;
    camera.position.set(Math.sin(view.azimuth) * flat, Math.sin(view.elevation) * reach, Math.cos(view.azimuth) * flat).add(centre);
    camera.near = reach / 100;
    camera.far = reach + 4 * radius;
    camera.updateProjectionMatrix();
    camera.lookAt(centre);
    // The light comes over the left shoulder of who looks.
    lamp.position.copy(camera.position).add(new THREE.Vector3(-0.6, 1, 0).applyQuaternion(camera.quaternion).multiplyScalar(reach * 0.6));
    lamp.target.position.copy(centre);
    lamp.target.updateMatrixWorld();
    fill.position.copy(camera.position);
    renderer.render(scene, camera);
    stage.dataset.azimuth = view.azimuth.toFixed(3);
    if (turning) ask();
  }
  function ask() {
    if (!wanted) {
      wanted = true;
      requestAnimationFrame(draw);
    }
  }
  function fit() {
    const width = stage.clientWidth, height = stage.clientHeight;
    if (!width || !height) return;
    renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    renderer.setSize(width, height);
    camera.aspect = width / height;
    ask();
  }
  function turn(azimuth, elevation) {
    setTurning(false);
    view.azimuth += azimuth;
    view.elevation = Math.max(-1.5, Math.min(1.5, view.elevation + elevation));
    ask();
  }
  function move(factor) {
    view.distance = Math.max(0.2, Math.min(5, view.distance * factor));
    ask();
  }

  const held = new Map();
  let spread = 0;
  stage.addEventListener("pointerdown", (event) => {
    stage.setPointerCapture(event.pointerId);
    held.set(event.pointerId, event);
    spread = 0;
  });
  stage.addEventListener("pointermove", (event) => {
    const before = held.get(event.pointerId);
    if (!before) return;
    held.set(event.pointerId, event);
    if (held.size === 1) {
      turn((before.clientX - event.clientX) * 0.01, (event.clientY - before.clientY) * 0.01);
    } else {
      const [one, two] = [...held.values()];
      const now = Math.hypot(one.clientX - two.clientX, one.clientY - two.clientY);
      if (spread && now) move(spread / now);
      spread = now;
    }
  });
  for (const name of ["pointerup", "pointercancel"]) {
    stage.addEventListener(name, (event) => held.delete(event.pointerId));
  }
  stage.addEventListener("wheel", (event) => {
    // The page scrolls as ever until the viewer is chosen.
    if (document.activeElement !== stage) return;
    event.preventDefault();
    move(Math.exp(event.deltaY * 0.001));
  }, { passive: false });
  stage.addEventListener("keydown", (event) => {
    const keys = {
      ArrowLeft: () => turn(0.15, 0), ArrowRight: () => turn(-0.15, 0),
      ArrowUp: () => turn(0, 0.15), ArrowDown: () => turn(0, -0.15),
      "+": () => move(0.9), "=": () => move(0.9), "-": () => move(1 / 0.9), 0: back, Home: back,
    };
    if (event.ctrlKey || event.metaKey || event.altKey || !keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  });

  function button(text, act, pressed) {
    const made = document.createElement("button");
    made.type = "button";
    made.textContent = text;
    if (pressed !== undefined) made.setAttribute("aria-pressed", String(pressed));
    made.addEventListener("click", act);
    return made;
  }
  function setTurning(on) {
    turning = on;
    spinner.setAttribute("aria-pressed", String(on));
    last = performance.now();
    if (on) ask();
  }
  function back() {
    setTurning(false);
    view = { ...FRONT };
    ask();
  }
  const spinner = button("Spin", () => setTurning(!turning), false);
  const shape = button("Shape only", () => {
    const on = shape.getAttribute("aria-pressed") !== "true";
    shape.setAttribute("aria-pressed", String(on));
    for (const [mesh, material] of own) mesh.material = on ? clay : material;
    ask();
  }, false);
  bar.append(spinner, shape, button("Reset", back), status);

  new THREE.GLTFLoader().parse(bytes, "", (gltf) => {
    model = gltf.scene;
    let faces = 0;
    model.traverse((part) => {
      if (!part.isMesh) return;
      own.set(part, part.material);
      if (!part.geometry.attributes.normal) part.geometry.computeVertexNormals();
      faces += (part.geometry.index || part.geometry.attributes.position).count / 3;
    });
    scene.add(model);
    const box = new THREE.Box3().setFromObject(model);
    const ball = box.getBoundingSphere(new THREE.Sphere());
    centre.copy(ball.center);
    radius = ball.radius || 1;
    status.textContent = `${faces.toLocaleString("en")} triangles`;
    stage.dataset.ready = "1";
    fit();
    if (!still.matches) setTurning(true);
  }, (error) => {
    stage.hidden = true;
    bar.replaceChildren(status);
    status.textContent = "The asset cannot be shown: see the pictures instead.";
  });
  still.addEventListener("change", () => still.matches && setTurning(false));
  new ResizeObserver(fit).observe(stage);
  return { turn, move, back };
}
