"use strict";
(() => {
  const data = JSON.parse(document.getElementById("scene").textContent);
  const holder = document.getElementById("view");
  if (!holder) return;
  const caption = document.getElementById("caption");
  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
  } catch (error) {
    holder.textContent = "This browser cannot draw in 3-D (no WebGL); all numbers stand in the text of this page.";
    return;
  }
  holder.appendChild(renderer.domElement);
  const scene = new THREE.Scene();
  const camera = new THREE.PerspectiveCamera(40, 1, 10, 20000);
  camera.up.set(0, 0, 1);
  scene.add(new THREE.HemisphereLight(0xffffff, 0x8899aa, 2.2));
  const sun = new THREE.DirectionalLight(0xffffff, 1.6);
  sun.position.set(500, -900, 1500);
  scene.add(sun);

  // colours follow the style sheet: light, dark or paper
  const coloured = [];
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
  const material = (kind, name, options = {}) => {
    const made = new kind({ ...options, transparent: (options.opacity ?? 1) < 1 });
    coloured.push([made, name]);
    return made;
  };
  const standard = (name, opacity = 1) => material(THREE.MeshStandardMaterial, name, { opacity, roughness: 0.6 });

  const vector = (p) => new THREE.Vector3(p[0], p[1], p[2]);
  const bounds = new THREE.Box3();
  const line = (points, name) => new THREE.Line(new THREE.BufferGeometry().setFromPoints(points), material(THREE.LineBasicMaterial, name));
  const bytes = (text, kind) => new kind(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);

  const solid = standard("solid");
  for (const box of data.boxes) {
    const size = vector(box.upper).sub(vector(box.lower));
    if (Math.max(size.x, size.y) > 1500) continue; // the table: a grid stands for it
    const mesh = new THREE.Mesh(new THREE.BoxGeometry(size.x, size.y, size.z), solid);
    mesh.position.copy(vector(box.lower)).addScaledVector(size, 0.5);
    scene.add(mesh);
    bounds.expandByObject(mesh);
  }
  const meshed = (part) => {
    const geometry = new THREE.BufferGeometry();
    const places = Float32Array.from(bytes(part.vertices, Int16Array), (x) => x * data.unit);
    geometry.setAttribute("position", new THREE.BufferAttribute(places, 3));
    geometry.setIndex(new THREE.BufferAttribute(bytes(part.triangles, Uint16Array), 1));
    const flat = geometry.toNonIndexed();
    flat.computeVertexNormals();
    return flat;
  };
  const shaped = {
    box: (size) => new THREE.BoxGeometry(...size),
    cylinder: ([radius, length]) => new THREE.CylinderGeometry(radius, radius, length, 32).rotateX(Math.PI / 2),
    sphere: ([radius]) => new THREE.SphereGeometry(radius, 24, 16),
  };
  for (const shape of data.shapes) {
    if (Math.max(...(shape.size || [0])) > 1500) continue;
    const mesh = new THREE.Mesh(shape.kind === "mesh" ? meshed(shape) : shaped[shape.kind](shape.size), solid);
    if (shape.pose) mesh.applyMatrix4(new THREE.Matrix4().set(...shape.pose));
    mesh.updateMatrixWorld();
    scene.add(mesh);
    bounds.expandByObject(mesh);
  }
  for (const face of data.faces) {
    const o = vector(face.origin), u = vector(face.u), v = vector(face.v);
    const corners = [o, o.clone().add(u), o.clone().add(u).add(v), o.clone().add(v), o];
    scene.add(line(corners, face.bare ? "out" : "edge"));
    corners.forEach((c) => bounds.expandByPoint(c));
  }
  if (data.zone) {
    const lower = vector(data.zone.lower), size = vector(data.zone.upper).sub(lower);
    const edges = new THREE.LineSegments(new THREE.EdgesGeometry(new THREE.BoxGeometry(size.x, size.y, size.z)), material(THREE.LineBasicMaterial, "good"));
    edges.position.copy(lower).addScaledVector(size, 0.5);
    scene.add(edges);
    bounds.expandByObject(edges);
  }
  let grid = null;

  const bead = new THREE.SphereGeometry(4, 12, 8), plain = material(THREE.MeshBasicMaterial, "after"), marked = material(THREE.MeshBasicMaterial, "out");
  const dots = data.touches.map((touch) => {
    const tip = touch.identified || touch.nominal;
    const dot = new THREE.Mesh(bead, touch.colour ? new THREE.MeshBasicMaterial({ color: touch.colour }) : plain);
    dot.userData.plain = dot.material;
    dot.position.copy(vector(tip[tip.length - 1]));
    scene.add(dot);
    return dot;
  });

  // where the tip goes from touch to touch; the way to the present one stands out
  const faint = material(THREE.LineBasicMaterial, "axis"), strong = material(THREE.LineBasicMaterial, "out");
  const paths = (data.paths || []).map((points) => {
    const path = new THREE.Line(new THREE.BufferGeometry().setFromPoints(points.map(vector)), faint);
    scene.add(path);
    return path;
  });

  // the arm by its meshes, where the robot has some; each link moves as a whole
  const skin = standard("after"), solids = (data.links || []).map((link) => {
    const mesh = new THREE.Mesh(meshed(link), skin);
    mesh.userData.link = link.link;
    return mesh;
  });

  const robots = { nominal: new THREE.Group(), identified: new THREE.Group() };
  const skins = { nominal: standard("before"), ghost: standard("before", 0.45), identified: skin };
  const rods = (group, points, look, first) => {
    for (let i = first; i + 1 < points.length; i++) {
      const a = vector(points[i]), b = vector(points[i + 1]), way = b.clone().sub(a), length = way.length();
      const thick = i + 2 === points.length ? 5 : 26 - 2.2 * i;
      const ball = new THREE.Mesh(new THREE.SphereGeometry(thick * 1.25, 18, 12), look);
      ball.position.copy(a);
      group.add(ball);
      if (length < 1) continue;
      const rod = new THREE.Mesh(new THREE.CylinderGeometry(thick * 0.6, thick, length, 18), look);
      rod.position.copy(a).addScaledVector(way, 0.5);
      rod.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), way.normalize());
      group.add(rod);
    }
  };
  const draw = (kind, touch) => {
    const group = robots[kind], points = touch[kind], meshed = touch.frames && kind === (touch.identified ? "identified" : "nominal");
    group.traverse((part) => { if (part.geometry && part.userData.link === undefined) part.geometry.dispose(); });
    group.clear();
    if (meshed) {
      for (const mesh of solids) {
        const [x, y, z, qx, qy, qz, qw] = touch.frames.slice(7 * mesh.userData.link, 7 * mesh.userData.link + 7);
        mesh.position.set(x, y, z);
        mesh.quaternion.set(qx, qy, qz, qw);
        group.add(mesh);
      }
    }
    rods(group, points, kind === "nominal" && touch.identified ? skins.ghost : meshed ? skins.nominal : skins[kind], meshed ? touch.frames.length / 7 - 1 : 0);
  };
  Object.values(robots).forEach((group) => scene.add(group));

  const slider = document.getElementById("step"), tick = { nominal: document.getElementById("nominal"), identified: document.getElementById("identified"), paths: document.getElementById("paths") };
  let current = 0;
  const show = (index) => {
    if (!data.touches.length) return;
    current = index;
    const touch = data.touches[index];
    for (const kind of ["nominal", "identified"]) {
      const on = Boolean(touch[kind]) && tick[kind] && tick[kind].checked;
      robots[kind].visible = on;
      if (on) draw(kind, touch);
    }
    dots.forEach((dot, i) => { dot.material = i === index ? marked : dot.userData.plain; dot.scale.setScalar(i === index ? 2.2 : 1); });
    paths.forEach((path, i) => { path.visible = tick.paths.checked; path.material = i === index ? strong : faint; });
    const place = `(${index + 1} of ${data.touches.length})`, words = touch.words ? ": " + touch.words : "";
    const text = touch.face === null ? `${touch.id} ${place}${words}` : `touch ${touch.id} ${place} on ${touch.face || "a plane"}${words}`;
    caption.textContent = text;
    renderer.domElement.setAttribute("aria-label", `3-D view of robot, jig and zone; ${text}`);
    slider.value = index;
    holder.dataset.step = index;
    paint();
  };
  renderer.domElement.setAttribute("role", "img");
  renderer.domElement.setAttribute("aria-label", "3-D view of robot, jig and zone");
  const controls = new THREE.OrbitControls(camera, renderer.domElement);
  const paint = () => { renderer.render(scene, camera); holder.dataset.camera = camera.position.toArray().map((x) => x.toFixed(1)).join(","); };
  controls.addEventListener("change", paint);
  const dress = () => {
    scene.background = new THREE.Color(colour("view"));
    coloured.forEach(([m, name]) => m.color.set(colour(name)));
    if (grid) scene.remove(grid);
    grid = new THREE.GridHelper(2000, 20, colour("axis"), colour("grid"));
    grid.rotation.x = Math.PI / 2;
    grid.position.z = -1;
    scene.add(grid);
  };
  dress();
  for (const query of ["(prefers-color-scheme: dark)", "print"]) matchMedia(query).addEventListener("change", () => { dress(); paint(); });

  data.touches.slice(0, 1).forEach((t) => t.nominal.forEach((p) => bounds.expandByPoint(vector(p))));
  if (solids.length && data.touches.length) {
    draw(data.touches[0].identified ? "identified" : "nominal", data.touches[0]);
    Object.values(robots).forEach((group) => { group.updateMatrixWorld(true); if (group.children.length) bounds.expandByObject(group); });
  }
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

  // the keyboard: arrows orbit, plus and minus zoom, page keys step
  const orbit = (around, above, nearer) => {
    moved = true;
    const way = camera.position.clone().sub(controls.target), far = way.length() * nearer;
    const azimuth = Math.atan2(way.y, way.x) + around, polar = Math.min(Math.max(Math.acos(way.z / way.length()) + above, 0.05), Math.PI - 0.05);
    way.set(Math.sin(polar) * Math.cos(azimuth), Math.sin(polar) * Math.sin(azimuth), Math.cos(polar)).multiplyScalar(far);
    camera.position.copy(controls.target).add(way);
    controls.update();
    paint();
  };
  const go = (by) => data.touches.length && show((current + by + data.touches.length) % data.touches.length);
  const keys = {
    ArrowLeft: () => orbit(-0.1, 0, 1), ArrowRight: () => orbit(0.1, 0, 1), ArrowUp: () => orbit(0, -0.1, 1), ArrowDown: () => orbit(0, 0.1, 1),
    "+": () => orbit(0, 0, 0.9), "-": () => orbit(0, 0, 1.1), PageUp: () => go(-1), PageDown: () => go(1),
  };
  holder.addEventListener("keydown", (event) => {
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  });
  if (slider) {
    slider.addEventListener("input", () => show(Number(slider.value)));
    document.getElementById("back").addEventListener("click", () => go(-1));
    document.getElementById("next").addEventListener("click", () => go(1));
    Object.values(tick).forEach((box) => box && box.addEventListener("change", () => show(current)));
    show(0);
  }
})();
