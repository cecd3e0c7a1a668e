
"use strict";

// Contents: the section at the upper third of the window is the current one.
const nav = document.querySelector("nav");
const links = new Map([...nav.querySelectorAll("ul a")].map(link => [link.hash.slice(1), link]));
const sections = [...document.querySelectorAll("main section")];
let current = null;
function highlight() {
  const line = innerHeight / 3;
  const atEnd = innerHeight + scrollY >= document.documentElement.scrollHeight - 2 && scrollY > 0;
  const passed = sections.filter(section => section.getBoundingClientRect().top <= line);
  const section = atEnd ? sections.at(-1) : passed.at(-1);
  const link = section ? links.get(section.id) : null;
  if (link === current) return;
  if (current) current.removeAttribute("aria-current");
  current = link;
  if (!link) return;
  link.setAttribute("aria-current", "location");
  // only the contents scroll, not the page
  const [at, box] = [link.getBoundingClientRect(), nav.getBoundingClientRect()];
  if (nav.scrollWidth > nav.clientWidth) nav.scrollLeft += at.left + at.width / 2 - box.left - box.width / 2;
  if (at.top < box.top || at.bottom > box.bottom) nav.scrollTop += at.top - box.top - box.height / 2;
}
let asked = false;
function ask() {
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => { asked = false; highlight(); });
}
addEventListener("scroll", ask, { passive: true });
addEventListener("resize", ask);
highlight();

function element(name, attributes, text) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text) made.textContent = text;
  return made;
}

// Dividers: a slider of the browser, so that keys, touch and screen readers work as they do elsewhere.
for (const figure of document.querySelectorAll("figure.compare")) {
  const pair = figure.querySelector(".pair");
  const [left, right] = [...pair.querySelectorAll("span")].map(label => label.textContent);
  const input = element("input", { type: "range", min: 0, max: 100, step: 1, value: 60, "aria-label": `Divider between ${left} and ${right}` });
  const show = () => {
    pair.style.setProperty("--at", input.value + "%");
    input.setAttribute("aria-valuetext", `${input.value} % ${left}`);
  };
  input.addEventListener("input", show);
  pair.append(element("div", { class: "grip", "aria-hidden": "true" }, "\u2194"), input);
  figure.classList.add("slider");
  show();
}

// Solids. The layout of the data is described beside the code that writes them.
const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));
const shorts = text => new Uint16Array(bytes(text).buffer);
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = a => { const l = Math.hypot(...a) || 1; return [a[0] / l, a[1] / l, a[2] / l]; };
const radians = degrees => degrees * Math.PI / 180;
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

function decode(data) {
  const solid = { ...data, at: [], corners: shorts(data.corners), shades: bytes(data.shades), palette: bytes(data.palette) };
  const steps = shorts(data.positions), high = [0, 0, 0];
  for (let i = 0; i < steps.length; i++) high[i % 3] = Math.max(high[i % 3], steps[i]);
  for (let i = 0; i < steps.length; i += 3) {
    solid.at.push([0, 1, 2].map(axis => (steps[i + axis] - high[axis] / 2) * data.step));
  }
  solid.radius = solid.at.reduce((most, p) => Math.max(most, Math.hypot(...p)), 1e-9);
  if (data.section) {
    const [x, y, z, offset] = data.section;
    const center = [0, 1, 2].map(axis => data.low[axis] + high[axis] / 2 * data.step);
    solid.cut = [x, y, z, offset - dot([x, y, z], center)];
  } else solid.cut = [0, 0, 0, 1];
  const count = solid.corners.length / 3;
  const face = t => [0, 1, 2].map(i => solid.corners[3 * t + i]);
  solid.normals = [];
  const around = solid.at.map(() => []);
  for (let t = 0; t < count; t++) {
    const [a, b, c] = face(t);
    solid.normals.push(cross(sub(solid.at[b], solid.at[a]), sub(solid.at[c], solid.at[a])));
    for (const v of [a, b, c]) around[v].push(t);
  }
  // edges, and those that are creases or borders
  const pairs = new Map();
  for (let t = 0; t < count; t++) {
    const corners = face(t);
    for (let i = 0; i < 3; i++) {
      const [a, b] = [corners[i], corners[(i + 1) % 3]];
      const key = Math.min(a, b) * 65536 + Math.max(a, b);
      if (pairs.has(key)) pairs.get(key).push(t); else pairs.set(key, [t]);
    }
  }
  const flat = solid.normals.map(unit);
  const [edges, creases, border] = [[], [], []];
  solid.outlines = [];
  const bend = data.crease === null ? -2 : Math.cos(radians(data.crease));
  for (const [key, faces] of pairs) {
    const ends = [...solid.at[Math.floor(key / 65536)], ...solid.at[key % 65536]];
    edges.push(...ends);
    if (data.crease === null) continue;
    if (faces.length !== 2 || dot(flat[faces[0]], flat[faces[1]]) < bend) creases.push(...ends);
    else solid.outlines.push({ ends, sides: faces.map(t => flat[t]) });
  }
  if (data.section && data.crease !== null) {
    const beyond = p => dot(solid.cut, p) - solid.cut[3];
    for (let t = 0; t < count; t++) {
      const corners = face(t).map(v => solid.at[v]);
      const through = [];
      corners.forEach((p, i) => {
        const q = corners[(i + 1) % 3], [from, to] = [beyond(p), beyond(q)];
        if ((from > 0) === (to > 0)) return;
        // a little on the side that stays
        const share = from / (from - to) + (from > 0 ? 1e-4 : -1e-4);
        through.push(...p.map((value, axis) => value + share * (q[axis] - value)));
      });
      if (through.length === 6) border.push(...through);
    }
  }
  const marked = [];
  for (const v of shorts(data.marked)) marked.push(...solid.at[v]);
  solid.lines = { edges: new Float32Array(edges), creases: new Float32Array(creases), border: new Float32Array(border), marked: new Float32Array(marked) };
  // corners with a normal and a color each: smooth up to an angle
  const smooth = Math.cos(radians(data.smooth));
  const corners = new ArrayBuffer(28 * 3 * count), floats = new Float32Array(corners), colors = new Uint8Array(corners);
  for (let t = 0; t < count; t++) {
    face(t).forEach((v, i) => {
      let normal = solid.normals[t];
      if (data.smooth > 0) {
        normal = [0, 0, 0];
        for (const other of around[v]) {
          if (dot(flat[other], flat[t]) >= smooth) for (let k = 0; k < 3; k++) normal[k] += solid.normals[other][k];
        }
      }
      const corner = 3 * t + i;
      floats.set(solid.at[v], 7 * corner);
      floats.set(unit(normal), 7 * corner + 3);
      colors.set(color(solid, t, v), 28 * corner + 24);
    });
  }
  solid.buffer = corners;
  return solid;
}

function color(solid, triangle, vertex) {
  const shade = { plain: 0, faces: solid.shades[triangle], vertices: solid.shades[vertex] }[solid.paint] || 0;
  return solid.palette.subarray(3 * shade, 3 * shade + 3);
}

// The axes of the view as rows: right, up, toward the eye.
function axes({ azimuth, elevation }) {
  const [a, e] = [radians(azimuth), radians(elevation)];
  const right = [Math.cos(a), Math.sin(a), 0];
  const eye = [Math.sin(a) * Math.cos(e), -Math.cos(a) * Math.cos(e), Math.sin(e)];
  return [right, cross(eye, right), eye];
}

// The scale and shift with which the first view fills the picture, as in the drawn one.
function framing(solid, width, height) {
  const [right, up] = axes(solid.first);
  const low = [Infinity, Infinity], high = [-Infinity, -Infinity];
  for (const p of solid.at) {
    [dot(right, p), dot(up, p)].forEach((value, axis) => {
      low[axis] = Math.min(low[axis], value);
      high[axis] = Math.max(high[axis], value);
    });
  }
  const scale = FILL * Math.min(width / (high[0] - low[0]), height / (high[1] - low[1]));
  return { scale, x: (low[0] + high[0]) / 2, y: (low[1] + high[1]) / 2 };
}
const FILL = 0.92;

// The edges where the surface turns away from the eye, as lines.
function outline(solid, view) {
  const eye = axes(view)[2];
  const seen = solid.outlines.filter(({ sides: [a, b] }) => (dot(eye, a) > 0) !== (dot(eye, b) > 0));
  return new Float32Array(seen.flatMap(edge => edge.ends));
}

// One WebGL context draws for all canvases, as a page gets few of them.
const VERTEX = `
attribute vec3 place, normal, color;
uniform mat3 turn; uniform vec4 frame; uniform vec4 cut; uniform float depth, lift;
varying vec3 n, c; varying float beyond;
void main() {
  vec3 p = turn * place;
  n = turn * normal; c = color; beyond = dot(cut.xyz, place) - cut.w;
  gl_Position = vec4((p.xy - frame.zw) * frame.xy, -p.z * depth - lift, 1.0);
}`;
// The lights of the drawn pictures.
const FRAGMENT = `
precision highp float;
varying vec3 n, c; varying float beyond;
uniform vec3 back, inside; uniform bool capped, numbers;
vec3 light(vec3 c) { return pow(c, vec3(2.2)); }
void main() {
  if (beyond > 0.0) discard;
  bool front = gl_FrontFacing;
  vec3 shown = light(inside);
  if (front || !capped) {
    vec3 m = normalize(front ? n : -n);
    m.z = max(m.z, 0.0); m = normalize(m + vec3(0.0, 0.0, 1e-4));
    vec3 key = vec3(-0.408248, 0.57735, 0.707107);
    float bright = 0.62 * max(dot(m, key), 0.0) + 0.15 * max(dot(m, vec3(0.805823, 0.161165, 0.569803)), 0.0) + 0.12 + 0.22 * (0.5 + 0.5 * m.y);
    shown = numbers ? light(c) * (front ? 1.0 : 0.55) : light(front ? c : back);
    if (numbers) bright = 1.0 + 0.5 * (bright - 1.0);
    shown *= bright;
    if (!numbers) shown += 0.14 * pow(max(dot(m, normalize(key + vec3(0.0, 0.0, 1.0))), 0.0), 32.0);
  }
  gl_FragColor = vec4(pow(clamp(shown, 0.0, 1.0), vec3(1.0 / 2.2)), 1.0);
}`;
const LINE = `
precision highp float;
varying float beyond; uniform vec3 ink;
void main() { if (beyond > 0.0) discard; gl_FragColor = vec4(ink, 1.0); }`;

const graphics = (() => {
  const canvas = document.createElement("canvas");
  const gl = canvas.getContext("webgl", { antialias: true, alpha: true, stencil: true, preserveDrawingBuffer: true });
  if (!gl) return null;
  let lost = false;
  canvas.addEventListener("webglcontextlost", () => { lost = true; });
  const program = (vertex, fragment) => {
    const made = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(made, shader);
    }
    ["place", "normal", "color"].forEach((name, index) => gl.bindAttribLocation(made, index, name));
    gl.linkProgram(made);
    return gl.getProgramParameter(made, gl.LINK_STATUS) ? made : null;
  };
  const [surface, line] = [program(VERTEX, FRAGMENT), program(VERTEX, LINE)];
  if (!surface || !line) return null;
  const kept = new Map();
  const buffer = data => {
    const made = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, made);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    return made;
  };
  const buffers = solid => {
    let made = kept.get(solid);
    if (!made) {
      made = { corners: buffer(solid.buffer), outline: gl.createBuffer() };
      for (const [name, ends] of Object.entries(solid.lines)) made[name] = buffer(ends);
      if (kept.size >= 8) {
        const [oldest, old] = kept.entries().next().value;
        Object.values(old).forEach(one => gl.deleteBuffer(one));
        kept.delete(oldest);
      }
      kept.set(solid, made);
    }
    return made;
  };
  const common = (used, solid, view, frame, lift) => {
    gl.useProgram(used);
    const at = name => gl.getUniformLocation(used, name);
    const [right, up, eye] = axes(view);
    gl.uniformMatrix3fv(at("turn"), false, [0, 1, 2].flatMap(i => [right[i], up[i], eye[i]]));
    gl.uniform4fv(at("frame"), frame);
    gl.uniform4fv(at("cut"), solid.cut);
    gl.uniform1f(at("depth"), 0.99 / solid.radius);
    gl.uniform1f(at("lift"), lift);
    return at;
  };
  return (solid, view, target, width, height, scale, shift) => {
    if (lost || gl.isContextLost()) return false;
    if (canvas.width < width) canvas.width = width;
    if (canvas.height < height) canvas.height = height;
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    const made = buffers(solid);
    const frame = [2 * scale / width, 2 * scale / height, ...shift];
    const at = common(surface, solid, view, frame, 0);
    const bright = rgb => rgb.map(value => value / 255);
    gl.uniform3fv(at("back"), bright(solid.back));
    gl.uniform3fv(at("inside"), bright(solid.inside));
    gl.uniform1i(at("capped"), solid.capped ? 1 : 0);
    gl.uniform1i(at("numbers"), solid.paint === "plain" ? 0 : 1);
    gl.bindBuffer(gl.ARRAY_BUFFER, made.corners);
    for (const index of [0, 1, 2]) gl.enableVertexAttribArray(index);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 28, 0);
    gl.vertexAttribPointer(1, 3, gl.FLOAT, false, 28, 12);
    gl.vertexAttribPointer(2, 3, gl.UNSIGNED_BYTE, true, 28, 24);
    // backs stand for what fills a cut: where they are seen, no line behind the cut is
    gl.enable(gl.STENCIL_TEST);
    gl.stencilFunc(gl.ALWAYS, 1, 255);
    gl.stencilOpSeparate(gl.FRONT, gl.KEEP, gl.KEEP, gl.ZERO);
    gl.stencilOpSeparate(gl.BACK, gl.KEEP, gl.KEEP, solid.capped ? gl.REPLACE : gl.ZERO);
    gl.drawArrays(gl.TRIANGLES, 0, solid.corners.length);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.KEEP);
    for (const index of [1, 2]) gl.disableVertexAttribArray(index);
    const turned = outline(solid, view);
    gl.bindBuffer(gl.ARRAY_BUFFER, made.outline);
    gl.bufferData(gl.ARRAY_BUFFER, turned, gl.STREAM_DRAW);
    for (const [name, ink, lift] of [["edges", solid.ink, 0.0015], ["creases", solid.lining, 0.002], ["outline", solid.lining, 0.002], ["border", solid.lining, 0.002], ["marked", [196, 30, 58], 0.003]]) {
      const ends = name === "outline" ? turned : solid.lines[name];
      if (!ends.length || (name === "edges" && !view.wire)) continue;
      const at = common(line, solid, view, frame, lift);
      gl.uniform3fv(at("ink"), bright(ink));
      gl.stencilFunc(name === "border" ? gl.ALWAYS : gl.EQUAL, 0, 255);
      gl.bindBuffer(gl.ARRAY_BUFFER, made[name]);
      gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 12, 0);
      gl.drawArrays(gl.LINES, 0, ends.length / 3);
    }
    target.clearRect(0, 0, width, height);
    target.drawImage(canvas, 0, canvas.height - height, width, height, 0, 0, width, height);
    return true;
  };
})();

// The same without WebGL: triangles from the farthest to the nearest, each flat.
function paint(solid, view, target, width, height, scale, shift) {
  const [right, up, eye] = axes(view);
  const places = solid.at.map(p => [
    width / 2 + scale * (dot(right, p) - shift[0]), height / 2 - scale * (dot(up, p) - shift[1]), dot(eye, p)]);
  const faces = [];
  for (let t = 0; t < solid.normals.length; t++) {
    const corners = [0, 1, 2].map(i => solid.corners[3 * t + i]);
    const middle = [0, 1, 2].map(axis => corners.reduce((sum, v) => sum + solid.at[v][axis], 0) / 3);
    if (dot(solid.cut, middle) > solid.cut[3]) continue;
    faces.push({ t, corners, far: corners.reduce((sum, v) => sum + places[v][2], 0) });
  }
  faces.sort((a, b) => a.far - b.far);
  target.clearRect(0, 0, width, height);
  target.lineWidth = 1;
  for (const { t, corners } of faces) {
    const normal = unit([right, up, eye].map(axis => dot(axis, solid.normals[t])));
    const front = normal[2] >= 0;
    const seen = front ? normal : normal.map(value => -value);
    let rgb = front ? color(solid, t, corners[0]) : solid.paint === "plain" ? solid.back : color(solid, t, corners[0]);
    let bright = 0.62 * Math.max(dot(seen, [-0.408, 0.577, 0.707]), 0) + 0.15 * Math.max(dot(seen, [0.806, 0.161, 0.57]), 0) + 0.23 + 0.11 * seen[1];
    if (solid.capped && !front) [rgb, bright] = [solid.inside, 1];
    const style = `rgb(${[...rgb].map(value => Math.round(value * bright ** 0.45)).join(",")})`;
    target.beginPath();
    for (const v of corners) target.lineTo(places[v][0], places[v][1]);
    target.closePath();
    target.fillStyle = style;
    target.strokeStyle = view.wire ? `rgb(${solid.ink.join(",")})` : style;
    target.fill();
    target.stroke();
  }
}

// A stage shows the drawn picture until somebody turns it.
class Stage {
  constructor(figure) {
    this.box = figure.querySelector(".stage");
    this.data = figure.querySelector("script");
    const name = this.box.querySelector("img").alt;
    this.canvas = element("canvas", {
      tabindex: 0, role: "application", "aria-label": `${name}: arrow keys turn, + and - zoom, W shows edges, 0 resets` });
    this.hint = element("div", { class: "hint", "aria-hidden": "true" }, "\u21bb drag to turn");
    this.tools = element("div", { class: "tools" });
    this.edges = element("button", { type: "button", "aria-pressed": "false" }, "Edges");
    this.home = element("button", { type: "button" }, "Reset");
    this.tools.append(this.edges, this.home);
    this.box.append(this.canvas, this.hint, this.tools);
    this.pointers = new Map();
    this.view = null;
    this.queued = false;
    this.listen();
  }

  load() {
    if (this.solid) return;
    this.solid = decode(JSON.parse(this.data.textContent));
    this.solid.first = { azimuth: this.solid.view[0], elevation: this.solid.view[1] };
    this.first();
  }

  first() {
    this.view = { ...this.solid.first, zoom: 1, wire: this.solid.wire };
    this.edges.setAttribute("aria-pressed", this.view.wire);
  }

  change(change) {
    this.load();
    change(this.view);
    this.view.elevation = clamp(this.view.elevation, -90, 90);
    this.view.zoom = clamp(this.view.zoom, 0.5, 30);
    this.edges.setAttribute("aria-pressed", this.view.wire);
    if (this.queued) return;
    this.queued = true;
    requestAnimationFrame(() => { this.queued = false; this.draw(); });
  }

  reset() {
    if (!this.solid) return;
    this.first();
    this.box.classList.remove("live");
    this.canvas.getContext("2d").clearRect(0, 0, this.canvas.width, this.canvas.height);
  }

  draw() {
    const sharp = Math.min(devicePixelRatio || 1, 2);
    const width = Math.max(1, Math.round(this.canvas.clientWidth * sharp));
    const height = Math.max(1, Math.round(this.canvas.clientHeight * sharp));
    if (this.canvas.width !== width) this.canvas.width = width;
    if (this.canvas.height !== height) this.canvas.height = height;
    const frame = framing(this.solid, width, height);
    // at the first view the picture stands where it was drawn; turned, the solid's middle stays in the middle
    const away = Math.hypot(this.view.azimuth - this.solid.first.azimuth, this.view.elevation - this.solid.first.elevation);
    const stay = Math.max(0, 1 - away / 45);
    const shift = [frame.x * stay, frame.y * stay];
    const target = this.canvas.getContext("2d");
    const given = [this.solid, this.view, target, width, height, frame.scale * this.view.zoom, shift];
    if (!graphics || !graphics(...given)) paint(...given);
    this.box.classList.add("live");
  }

  listen() {
    const { canvas, pointers } = this;
    canvas.addEventListener("pointerenter", () => this.load(), { once: true });
    canvas.addEventListener("pointerdown", event => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    canvas.addEventListener("pointermove", event => {
      const before = pointers.get(event.pointerId);
      if (!before) return;
      const [x, y] = [event.clientX, event.clientY];
      const apart = () => { const [a, b] = [...pointers.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]) || 1; };
      if (pointers.size === 2) {
        const was = apart();
        pointers.set(event.pointerId, [x, y]);
        this.change(view => { view.zoom *= apart() / was; });
        return;
      }
      pointers.set(event.pointerId, [x, y]);
      const degrees = 220 / canvas.clientWidth;
      this.change(view => {
        view.azimuth -= (x - before[0]) * degrees;
        view.elevation += (y - before[1]) * degrees;
      });
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, event => pointers.delete(event.pointerId));
    // the page scrolls on, unless the solid was chosen
    canvas.addEventListener("wheel", event => {
      if (document.activeElement !== canvas) return;
      event.preventDefault();
      this.change(view => { view.zoom *= Math.exp(-0.0015 * event.deltaY * (event.deltaMode ? 30 : 1)); });
    }, { passive: false });
    canvas.addEventListener("dblclick", () => this.reset());
    canvas.addEventListener("keydown", event => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const acts = {
        ArrowLeft: view => { view.azimuth += 10; }, ArrowRight: view => { view.azimuth -= 10; },
        ArrowUp: view => { view.elevation -= 10; }, ArrowDown: view => { view.elevation += 10; },
        "+": view => { view.zoom *= 1.2; }, "=": view => { view.zoom *= 1.2; }, "-": view => { view.zoom /= 1.2; },
        w: view => { view.wire = !view.wire; }, W: view => { view.wire = !view.wire; },
      };
      if (event.key === "0" || event.key === "Home") this.reset();
      else if (event.key === "Escape") { canvas.blur(); return; }
      else if (acts[event.key]) this.change(acts[event.key]);
      else return;
      event.preventDefault();
    });
    this.edges.addEventListener("click", () => this.change(view => { view.wire = !view.wire; }));
    this.home.addEventListener("click", () => this.reset());
    new ResizeObserver(() => { if (this.box.classList.contains("live")) this.change(() => {}); }).observe(this.box);
  }
}
for (const figure of document.querySelectorAll("figure.solid")) new Stage(figure);
