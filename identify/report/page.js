"use strict";
(() => {
  const data = JSON.parse(document.getElementById("scene").textContent);
  const holder = document.getElementById("view");
  if (!holder) return;
  const say = document.getElementById("said");
  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
  } catch (error) {
    holder.textContent = "This browser cannot draw in 3-D (no WebGL); all numbers stand in the tables.";
    return;
  }
  holder.appendChild(renderer.domElement);
  const scene = new THREE.Scene();
  scene.background = new THREE.Color(0xf7f9fb);
  const camera = new THREE.PerspectiveCamera(40, 1, 10, 20000);
  camera.up.set(0, 0, 1);
  scene.add(new THREE.HemisphereLight(0xffffff, 0x8899aa, 2.2));
  const sun = new THREE.DirectionalLight(0xffffff, 1.6);
  sun.position.set(500, -900, 1500);
  scene.add(sun);

  const vector = (p) => new THREE.Vector3(p[0], p[1], p[2]);
  const bounds = new THREE.Box3();
  const line = (points, colour, opacity = 1) => new THREE.Line(new THREE.BufferGeometry().setFromPoints(points),
    new THREE.LineBasicMaterial({ color: colour, transparent: opacity < 1, opacity }));

  for (const box of data.boxes) {
    const size = vector(box.upper).sub(vector(box.lower));
    if (Math.max(size.x, size.y) > 1500) continue; // the table: a grid stands for it
    const mesh = new THREE.Mesh(new THREE.BoxGeometry(size.x, size.y, size.z), new THREE.MeshStandardMaterial({ color: 0xb9c4cf, roughness: 0.7 }));
    mesh.position.copy(vector(box.lower)).addScaledVector(size, 0.5);
    scene.add(mesh);
    bounds.expandByObject(mesh);
  }
  for (const face of data.faces) {
    const o = vector(face.origin), u = vector(face.u), v = vector(face.v);
    const corners = [o, o.clone().add(u), o.clone().add(u).add(v), o.clone().add(v), o];
    scene.add(line(corners, 0x44525f));
    corners.forEach((c) => bounds.expandByPoint(c));
  }
  if (data.zone) {
    const lower = vector(data.zone.lower), size = vector(data.zone.upper).sub(lower);
    const edges = new THREE.LineSegments(new THREE.EdgesGeometry(new THREE.BoxGeometry(size.x, size.y, size.z)), new THREE.LineBasicMaterial({ color: 0x1e7d4f }));
    edges.position.copy(lower).addScaledVector(size, 0.5);
    scene.add(edges);
    bounds.expandByObject(edges);
  }
  const grid = new THREE.GridHelper(2000, 20, 0xc3ccd5, 0xe3e8ed);
  grid.rotation.x = Math.PI / 2;
  grid.position.z = -1;
  scene.add(grid);

  const dots = data.touches.map((touch) => {
    const tip = touch.identified || touch.nominal;
    const dot = new THREE.Mesh(new THREE.SphereGeometry(4, 12, 8), new THREE.MeshBasicMaterial({ color: 0x1f6fb2 }));
    dot.position.copy(vector(tip[tip.length - 1]));
    scene.add(dot);
    return dot;
  });

  const robots = { nominal: new THREE.Group(), identified: new THREE.Group() };
  const draw = (group, points, colour, opacity) => {
    group.traverse((part) => { if (part.geometry) part.geometry.dispose(); });
    group.clear();
    const material = new THREE.MeshStandardMaterial({ color: colour, transparent: opacity < 1, opacity, roughness: 0.5 });
    for (let i = 0; i + 1 < points.length; i++) {
      const a = vector(points[i]), b = vector(points[i + 1]), way = b.clone().sub(a), length = way.length();
      const thick = i + 2 === points.length ? 5 : 26 - 2.2 * i;
      const ball = new THREE.Mesh(new THREE.SphereGeometry(thick * 1.25, 18, 12), material);
      ball.position.copy(a);
      group.add(ball);
      if (length < 1) continue;
      const rod = new THREE.Mesh(new THREE.CylinderGeometry(thick * 0.6, thick, length, 18), material);
      rod.position.copy(a).addScaledVector(way, 0.5);
      rod.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), way.normalize());
      group.add(rod);
    }
  };
  Object.values(robots).forEach((group) => scene.add(group));

  const slider = document.getElementById("step"), tick = { nominal: document.getElementById("nominal"), identified: document.getElementById("identified") };
  const show = (index) => {
    if (!data.touches.length) return;
    const touch = data.touches[index];
    for (const kind of ["nominal", "identified"]) {
      const on = Boolean(touch[kind]) && tick[kind] && tick[kind].checked;
      robots[kind].visible = on;
      if (on) draw(robots[kind], touch[kind], kind === "nominal" ? 0xb0752c : 0x1f6fb2, kind === "nominal" && touch.identified ? 0.45 : 1);
    }
    dots.forEach((dot, i) => { dot.material.color.set(i === index ? 0xc0392b : 0x1f6fb2); dot.scale.setScalar(i === index ? 2.2 : 1); });
    say.textContent = `touch ${touch.id} (${index + 1} of ${data.touches.length}) on ${touch.face || "a plane"}${touch.words ? ": " + touch.words : ""}`;
    slider.value = index;
    holder.dataset.step = index;
    paint();
  };
  const controls = new THREE.OrbitControls(camera, renderer.domElement);
  const paint = () => { renderer.render(scene, camera); holder.dataset.camera = camera.position.toArray().map((x) => x.toFixed(1)).join(","); };
  controls.addEventListener("change", paint);

  data.touches.slice(0, 1).forEach((t) => t.nominal.forEach((p) => bounds.expandByPoint(vector(p))));
  const middle = bounds.getCenter(new THREE.Vector3()), half = bounds.getSize(new THREE.Vector3()).multiplyScalar(0.5);
  const back = new THREE.Vector3(0.75, -0.85, 0.6).normalize();
  const right = new THREE.Vector3().crossVectors(camera.up, back).normalize(), up = new THREE.Vector3().crossVectors(back, right);
  controls.target.copy(middle);
  let moved = false;
  controls.addEventListener("start", () => { moved = true; });
  const frame = () => { // as near as all of it is seen, until the reader chooses
    const tall = Math.tan(camera.fov * Math.PI / 360), corner = new THREE.Vector3();
    let away = 300;
    for (let i = 0; i < 8; i++) {
      corner.set(i & 1 ? half.x : -half.x, i & 2 ? half.y : -half.y, i & 4 ? half.z : -half.z);
      away = Math.max(away, corner.dot(back) + 1.08 * Math.max(Math.abs(corner.dot(right)) / camera.aspect, Math.abs(corner.dot(up))) / tall);
    }
    camera.position.copy(middle).addScaledVector(back, away);
    controls.update();
  };
  const resize = () => {
    const { clientWidth: w, clientHeight: h } = holder;
    if (!w || !h) return;
    renderer.setPixelRatio(Math.min(devicePixelRatio || 1, 2));
    renderer.setSize(w, h, false);
    camera.aspect = w / h;
    camera.updateProjectionMatrix();
    if (!moved) frame();
    paint();
  };
  new ResizeObserver(resize).observe(holder);
  resize();
  controls.update();
  if (slider) {
    const go = (by) => show((Number(slider.value) + by + data.touches.length) % data.touches.length);
    slider.addEventListener("input", () => show(Number(slider.value)));
    document.getElementById("back").addEventListener("click", () => go(-1));
    document.getElementById("next").addEventListener("click", () => go(1));
    Object.values(tick).forEach((box) => box && box.addEventListener("change", () => show(Number(slider.value))));
    show(0);
  }
})();
