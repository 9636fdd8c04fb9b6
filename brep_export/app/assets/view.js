// The view of a report that one can turn. Reads the scene in the page, fetches nothing.
"use strict";
(() => {
  const frame = document.getElementById("view");
  const scene = JSON.parse(document.getElementById("scene").textContent);
  const FREE_EDGE = "#d62020";
  const ANGLES = [
    { below: 0, colour: FREE_EDGE, name: "free: one face only" },
    { below: 0.1, colour: "#1a9850", name: "smooth, to 0.1°" },
    { below: 1, colour: "#e0a500", name: "0.1° to 1°" },
    { below: 10, colour: "#e8641b", name: "1° to 10°" },
    { below: Infinity, colour: "#283593", name: "sharp, above 10°" },
  ];
  const SIDES = {
    corner: [1, -1.6, 0.9], front: [0, -1, 0], back: [0, 1, 0], left: [-1, 0, 0], right: [1, 0, 0],
    top: [0, 0, 1], below: [0, 0, -1],
  };
  const BINS = 44;

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const array = (Type, text) => (text === null ? null : new Type(bytes(text)));
  const node = (tag, fields = {}, ...inside) => {
    const made = Object.assign(document.createElement(tag), fields);
    made.append(...inside);
    return made;
  };
  const figure = (x) => (x === 0 ? "0" : Math.abs(x) >= 1e5 || Math.abs(x) < 1e-3 ? x.toExponential(1) : x.toPrecision(3));

  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true, preserveDrawingBuffer: true });
  } catch {
    frame.replaceChildren(node("p", { className: "hint", textContent: "This browser draws no 3D view; see the pictures." }));
    return;
  }
  renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
  const stage = frame.querySelector(".stage");
  const panel = frame.querySelector(".panel");
  stage.append(renderer.domElement);

  const world = new THREE.Scene();
  const camera = new THREE.PerspectiveCamera(30, 1, 1, 10);
  camera.up.set(0, 0, 1);
  const light = new THREE.DirectionalLight(0xffffff, 2.2);
  light.position.set(-0.4, 0.6, 1);
  camera.add(light);
  world.add(camera, new THREE.HemisphereLight(0xffffff, 0x8a93a0, 1.5));

  const ZEBRA = new THREE.ShaderMaterial({
    side: THREE.DoubleSide, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1,
    vertexShader: `varying vec3 n; varying vec3 p;
      void main() { n = normalMatrix * normal; vec4 at = modelViewMatrix * vec4(position, 1.0); p = at.xyz;
        gl_Position = projectionMatrix * at; }`,
    fragmentShader: `varying vec3 n; varying vec3 p;
      void main() { vec3 m = normalize(n) * (gl_FrontFacing ? 1.0 : -1.0); vec3 r = reflect(normalize(p), m);
        float t = 24.0 * atan(r.y, length(r.xz)); float w = max(fwidth(t), 1e-4);
        float s = smoothstep(-w, w, sin(t)); float d = 0.75 + 0.25 * max(m.z, 0.0);
        gl_FragColor = vec4(mix(vec3(0.06), vec3(0.97), s) * d, 1.0); }`,
  });

  const plainMaterial = (colour) => new THREE.MeshLambertMaterial({
    color: colour, side: THREE.DoubleSide, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1,
  });
  const widths = [];
  const lineMaterial = (colour, width) => {
    const made = new THREE.LineMaterial({ color: colour, linewidth: width });
    widths.push(made);
    return made;
  };

  function meshOf(part) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(part.points, 3));
    geometry.setIndex(new THREE.BufferAttribute(part.cells, 1));
    if (part.normals) geometry.setAttribute("normal", new THREE.BufferAttribute(part.normals, 3, true));
    else geometry.computeVertexNormals();
    part.plain = plainMaterial(part.colour);
    part.coloured = plainMaterial("#ffffff");
    part.coloured.vertexColors = true;
    part.pale = plainMaterial("#d9dde3");
    return new THREE.Mesh(geometry, part.plain);
  }

  function linesOf(part) {
    const order = part.cells || [];
    const ends = part.cells ? new Float32Array(3 * order.length) : part.points;
    order.forEach((vertex, i) => ends.set(part.points.subarray(3 * vertex, 3 * vertex + 3), 3 * i));
    part.ends = ends;
    const geometry = new THREE.LineSegmentsGeometry();
    geometry.setPositions(ends);
    part.free = part.angles !== null && part.angles.some((angle) => angle < 0);
    part.plain = lineMaterial(part.free ? "#ffffff" : part.colour, part.angles ? (part.free ? 2 : 1) : 1.6);
    part.coloured = lineMaterial("#ffffff", 3);
    part.coloured.vertexColors = true;
    part.plain.vertexColors = part.free;
    geometry.setColors(new Float32Array(ends.length));
    return new THREE.LineSegments2(geometry, part.plain);
  }

  /** By angle; or, of edges in their own colour, the free ones in red all the same. */
  function edgeColours(part, byAngle) {
    const colours = new Float32Array(part.ends.length);
    const own = ANGLES.map((entry, i) => (byAngle || i === 0 ? entry.colour : part.colour));
    const rgb = own.map((name) => new THREE.Color(name).toArray());
    part.angles.forEach((angle, leg) => {
      const c = rgb[classOf(angle)];
      colours.set(c, 6 * leg);
      colours.set(c, 6 * leg + 3);
    });
    return colours;
  }
  const classOf = (angle) => (angle < 0 ? 0 : ANGLES.findIndex((entry, i) => i > 0 && angle <= entry.below));

  function pointsOf(part) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(part.points, 3));
    part.plain = new THREE.PointsMaterial({ color: part.colour, size: 5, sizeAttenuation: false });
    part.coloured = new THREE.PointsMaterial({ size: 7, sizeAttenuation: false, vertexColors: true });
    return new THREE.Points(geometry, part.plain);
  }

  const make = { mesh: meshOf, lines: linesOf, points: pointsOf };
  const order = (given) => (given.result ? 0 : 1);
  const parts = [...scene.parts].sort((a, b) => order(a) - order(b)).map((given) => {
    const part = {
      ...given,
      points: array(Float32Array, given.points), cells: array(Uint32Array, given.cells),
      normals: array(Int16Array, given.normals), values: array(Float32Array, given.values),
      angles: array(Float32Array, given.angles),
    };
    part.object = make[part.kind](part);
    part.object.visible = part.shown;
    world.add(part.object);
    return part;
  });

  // --- what is to be seen -------------------------------------------------------------------------------------------
  const scales = [...new Set(parts.filter((part) => part.values).map((part) => part.scale))];
  const modes = [{ key: "plain", name: "the parts" }];
  scales.forEach((scale) => modes.push({ key: `scale ${scale}`, name: scale, scale }));
  if (parts.some((part) => part.angles)) modes.push({ key: "edges", name: "edges by angle" });
  if (parts.some((part) => part.result && part.kind === "mesh")) modes.push({ key: "zebra", name: "zebra stripes" });
  let mode = modes[0];
  const ends = Object.fromEntries(scales.map((scale) => [scale, quantile(valuesOf(scale, true), 0.99) || 1]));

  function valuesOf(scale, hiddenToo) {
    const rows = parts.filter((part) => part.values && part.scale === scale && (hiddenToo || part.object.visible));
    return Float32Array.from(rows.flatMap((part) => [...part.values]).filter(Number.isFinite));
  }
  function quantile(values, share) {
    return values.length ? Float32Array.from(values).sort()[Math.floor(share * (values.length - 1))] : 0;
  }
  const shades = scene.shades.map((shade) => new THREE.Color(shade));
  const shadeOf = (share) => Math.max(0, Math.min(shades.length - 1, Math.round(share * (shades.length - 1))));

  const UNKNOWN = new THREE.Color("#c8c8c8");
  const shade = (value, scale) => (Number.isFinite(value) ? shades[shadeOf(value / ends[scale])] : UNKNOWN);

  function colour(part) {
    const order = part.kind === "lines" ? part.cells : part.values.map((_, i) => i);
    const colours = new Float32Array(3 * order.length);
    order.forEach((point, i) => shade(part.values[point], part.scale).toArray(colours, 3 * i));
    if (part.kind === "lines") part.object.geometry.setColors(colours);
    else part.object.geometry.setAttribute("color", new THREE.BufferAttribute(colours, 3));
  }

  function materialOf(part) {
    if (mode.scale !== undefined && part.values && part.scale === mode.scale) return part.coloured;
    if (mode.key === "edges" && part.angles) return part.coloured;
    if (mode.key === "edges" && part.result && part.kind === "mesh") return part.pale;
    if (mode.key === "zebra" && part.result && part.kind === "mesh") return ZEBRA;
    return part.plain;
  }

  function show() {
    parts.forEach((part) => {
      if (mode.scale !== undefined && part.values && part.scale === mode.scale) colour(part);
      if (part.angles && (part.free || mode.key === "edges")) {
        part.object.geometry.setColors(edgeColours(part, mode.key === "edges"));
      }
      part.object.material = materialOf(part);
    });
    legend.replaceChildren(...legendOf());
    draw();
  }

  // --- panel --------------------------------------------------------------------------------------------------------
  const legend = node("div", { className: "legend" });

  function partRow(part) {
    const box = node("input", { type: "checkbox", checked: part.shown });
    box.onchange = () => { part.object.visible = box.checked; show(); };
    part.box = box;
    const swatch = node("i", { className: "swatch" });
    swatch.style.background = part.colour;
    return node("label", { title: part.name }, box, swatch, part.name);
  }

  function modeRow(entry) {
    const button = node("input", { type: "radio", name: "mode", value: entry.key, checked: entry === mode });
    button.onchange = () => {
      mode = entry;
      const needed = parts.filter((part) => (entry.scale === undefined
        ? part.result && (entry.key === "edges" ? part.angles : entry.key === "zebra" && part.kind === "mesh") : part.values && part.scale === entry.scale));
      if (needed.length && !needed.some((part) => part.object.visible)) {
        if (entry.key === "edges") needed.forEach((part) => { part.object.visible = part.box.checked = true; });
        else only(needed);
      }
      show();
    };
    return node("label", {}, button, entry.name);
  }

  /** Show some parts, with the edges of those that are shapes, and hide all others. */
  function only(kept) {
    const edges = kept.map((part) => `edges of ${part.name}`);
    parts.forEach((part) => { part.object.visible = part.box.checked = kept.includes(part) || edges.includes(part.name); });
  }
  function chooser(name, chosen) {
    const button = node("button", { type: "button", textContent: name });
    button.onclick = () => { only(parts.filter(chosen)); show(); };
    return button;
  }
  const choosers = node("div", { className: "choosers" }, chooser("all", () => true));
  if (parts.some((part) => part.result) && parts.some((part) => !part.result)) {
    choosers.append(chooser("made", (part) => part.result), chooser("measured", (part) => !part.result));
  }

  function legendOf() {
    if (mode.key === "edges") return edgeLegend();
    return mode.scale === undefined ? [] : scaleLegend(mode.scale);
  }

  function edgeLegend() {
    const lengths = ANGLES.map(() => 0);
    parts.filter((part) => part.angles && part.object.visible).forEach((part) => part.angles.forEach((angle, leg) => {
      const [a, b, c, d, e, f] = part.ends.subarray(6 * leg, 6 * leg + 6);
      lengths[classOf(angle)] += Math.hypot(d - a, e - b, f - c);
    }));
    return ANGLES.map((entry, i) => {
      const swatch = node("i", { className: "swatch" });
      swatch.style.background = entry.colour;
      return node("p", {}, swatch, `${entry.name}: ${figure(lengths[i])} ${scene.unit}`);
    }).concat(parts.filter((part) => part.angles && part.scale).map((part) => node("p", { textContent: part.scale })));
  }

  function scaleLegend(scale) {
    const values = valuesOf(scale, false);
    if (!values.length) return [node("p", { textContent: "the parts with these colours are hidden" })];
    const largest = values.reduce((a, b) => Math.max(a, b), 0), end = ends[scale];
    const counts = new Array(BINS).fill(0);
    values.forEach((value) => counts[Math.max(0, Math.min(BINS - 1, Math.floor((value / end) * BINS)))]++);
    const most = Math.max(...counts);
    const bars = node("div", { className: "bars" }, ...counts.map((count, i) => {
      const bar = node("i", { title: `${figure((i * end) / BINS)} to ${i === BINS - 1 ? figure(largest) : figure(((i + 1) * end) / BINS)}: ${((100 * count) / values.length).toFixed(1)} %` });
      bar.style.height = `${(100 * count) / most}%`;
      bar.style.background = scene.shades[shadeOf((i + 0.5) / BINS)];
      return bar;
    }));
    const ramp = node("div", { className: "ramp" });
    ramp.style.background = `linear-gradient(to right, ${scene.shades.join(",")})`;
    const mean = values.reduce((a, b) => a + b, 0) / values.length;
    const slider = node("input", { type: "range", min: 0.02, max: 1, step: 0.01, value: largest ? end / largest : 1, title: "where the colours end" });
    slider.setAttribute("aria-label", "where the colours end");
    slider.oninput = () => { ends[scale] = Math.max(slider.value * largest, 1e-12); colourAll(scale); };
    return [
      node("p", { textContent: scale }), bars, ramp,
      node("div", { className: "ticks" }, node("span", { textContent: "0" }), node("span", { textContent: figure(end / 2) }), node("span", { textContent: figure(end) })),
      node("p", { textContent: `mean ${figure(mean)}, 95 % below ${figure(quantile(values, 0.95))}, largest ${figure(largest)}` }),
      node("label", {}, "colours end at ", slider),
    ];
  }

  function colourAll(scale) {
    parts.filter((part) => part.values && part.scale === scale).forEach(colour);
    const [before, slider] = [legend.querySelector("input"), scaleLegend(scale)];
    slider[slider.length - 1].replaceChildren("colours end at ", before);
    legend.replaceChildren(...slider);
    before.focus();
    draw();
  }

  panel.append(
    node("fieldset", {}, node("legend", { textContent: "Parts" }), choosers, node("div", { className: "rows" }, ...parts.map(partRow))),
    node("fieldset", {}, node("legend", { textContent: "Show" }), ...modes.map(modeRow)),
    legend,
  );

  // --- camera -------------------------------------------------------------------------------------------------------
  const controls = new THREE.TrackballControls(camera, renderer.domElement);
  Object.assign(controls, { staticMoving: true, rotateSpeed: 3, zoomSpeed: 1.2, panSpeed: 0.6, noZoom: true, keys: ["", "", ""] });
  renderer.domElement.addEventListener("pointerdown", () => { controls.noZoom = false; });
  renderer.domElement.addEventListener("pointerleave", () => { controls.noZoom = true; });

  function boxOf(rows) {
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    rows.forEach((part) => part.points.forEach((x, i) => {
      if (x < low[i % 3]) low[i % 3] = x;
      if (x > high[i % 3]) high[i % 3] = x;
    }));
    return [new THREE.Vector3(...low), new THREE.Vector3(...high)];
  }
  /** How far away, along a direction, all corners of a box are seen. */
  function distance(low, high, toward) {
    const centre = low.clone().add(high).multiplyScalar(0.5);
    const up = new THREE.Vector3(0, Math.abs(toward.z) > 0.99 ? 1 : 0, Math.abs(toward.z) > 0.99 ? 0 : 1);
    const right = up.clone().cross(toward).normalize();
    const above = toward.clone().cross(right);
    const slope = Math.tan((camera.fov * Math.PI) / 360);
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => new THREE.Vector3(
      (k & 1 ? high : low).x, (k & 2 ? high : low).y, (k & 4 ? high : low).z).sub(centre));
    return Math.max(...corners.map((corner) => corner.dot(toward) + Math.max(
      Math.abs(corner.dot(right)) / (slope * camera.aspect), Math.abs(corner.dot(above)) / slope)));
  }
  function look(direction) {
    const seen = parts.filter((part) => part.object.visible);
    const [low, high] = boxOf(seen.length ? seen : parts);
    const centre = low.clone().add(high).multiplyScalar(0.5);
    const radius = Math.max(low.distanceTo(high) / 2, 1e-9);
    const toward = direction.clone().normalize();
    const away = toward.clone().multiplyScalar(Math.max(1.06 * distance(low, high, toward), 1e-6));
    camera.up.set(0, Math.abs(away.z) > 0.99 * away.length() ? 1 : 0, Math.abs(away.z) > 0.99 * away.length() ? 0 : 1);
    controls.target.copy(centre);
    camera.position.copy(centre).add(away);
    camera.near = radius / 100;
    camera.far = radius * 40;
    camera.updateProjectionMatrix();
    controls.update();
    draw();
  }
  /** From where the made part is seen, where it lies at the side of what was measured; else from a corner. */
  function start() {
    const seen = (result) => parts.filter((part) => part.object.visible && part.kind === "mesh" && part.result === result);
    if (!seen(true).length || !seen(false).length) return new THREE.Vector3(...SIDES.corner);
    const middle = (rows) => { const [low, high] = boxOf(rows); return low.add(high).multiplyScalar(0.5); };
    const [low, high] = boxOf(seen(false));
    const away = middle(seen(true)).sub(middle(seen(false))).setZ(0);
    if (away.length() < 0.05 * low.distanceTo(high)) return new THREE.Vector3(...SIDES.corner);
    return away.normalize().add(new THREE.Vector3(0, 0, 0.35));
  }

  const sides = node("div", { className: "sides" }, ...Object.keys(SIDES).map((name) => {
    const button = node("button", { type: "button", textContent: name });
    button.onclick = () => look(new THREE.Vector3(...SIDES[name]));
    return button;
  }));
  stage.append(sides, node("p", { className: "hint", textContent: "drag: turn · right drag: move · click, then wheel: zoom" }));

  let waiting = false;
  function draw() {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      renderer.render(world, camera);
      frame.dataset.drawn = String(Number(frame.dataset.drawn || 0) + 1);
    });
  }
  function fit() {
    const { clientWidth: width, clientHeight: height } = stage;
    renderer.setSize(width, height);
    widths.forEach((material) => material.resolution.set(width, height));
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    controls.handleResize();
    draw();
  }
  controls.addEventListener("change", draw);
  (function turn() { controls.update(); requestAnimationFrame(turn); })();
  new ResizeObserver(fit).observe(stage);
  fit();
  look(start());
  show();

  document.querySelectorAll("[data-part]").forEach((figureOf) => {
    figureOf.onclick = () => {
      const seen = parts.filter((part) => !part.result && part.object.visible);
      only([...seen, ...parts.filter((part) => part.name === figureOf.dataset.part)]);
      show();
      frame.scrollIntoView({ block: "nearest" });
    };
  });
})();
