// Solids to be turned: a <canvas data-scenes> each; studies/scene.py says what the data are.
const VERTEX = `#version 300 es
in vec3 place; in float value;
uniform vec3 low, mirror; uniform vec2 shift; uniform float unit, size, aspect, depth; uniform mat3 turn;
out float shade; out vec3 eye;
void main() {
  eye = turn * (mirror * (low + unit * place)) / size;
  shade = value;
  gl_Position = vec4((eye.x + shift.x) / aspect, eye.y + shift.y, -depth * eye.z, 1.0);
}`;
const FRAGMENT = `#version 300 es
precision highp float; in float shade; in vec3 eye; uniform sampler2D palette; out vec4 colour;
void main() {
  vec3 normal = normalize(cross(dFdx(eye), dFdy(eye)));
  colour = vec4(texture(palette, vec2(shade, 0.5)).rgb * (0.6 + 0.4 * abs(normal.z)), 1.0);
}`;
const bytes = text => Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
const START = { spin: 0.35, tilt: -0.95, zoom: 1, x: 0, y: 0 };

function view(figure) {
  const canvas = figure.querySelector("canvas"), scenes = JSON.parse(canvas.dataset.scenes);
  const gl = canvas.getContext("webgl2", { preserveDrawingBuffer: true, antialias: true });
  if (!gl) return;
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) return;
  gl.useProgram(program);
  gl.enable(gl.DEPTH_TEST);
  gl.clearColor(1, 1, 1, 1);
  const uniform = name => gl.getUniformLocation(program, name);
  const state = { ...START, scene: null, open: false };
  const find = name => figure.querySelector(`[data-do=${name}]`);

  function fill(target, data) {
    gl.bindBuffer(target, gl.createBuffer());
    gl.bufferData(target, data, gl.STATIC_DRAW);
  }
  function attribute(name, data, width, kind, normalised) {
    fill(gl.ARRAY_BUFFER, data);
    const place = gl.getAttribLocation(program, name);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, width, kind, normalised, 0, 0);
  }
  function load(scene) {
    state.scene = scene;
    attribute("place", new Uint16Array(bytes(scene.points).buffer), 3, gl.UNSIGNED_SHORT, false);
    attribute("value", bytes(scene.values), 1, gl.UNSIGNED_BYTE, true);
    const Numbers = scene.wide ? Uint32Array : Uint16Array;
    const outside = new Numbers(bytes(scene.triangles).buffer), cut = new Numbers(bytes(scene.cut).buffer);
    const all = new Numbers(outside.length + cut.length);
    all.set(outside);
    all.set(cut, outside.length);
    fill(gl.ELEMENT_ARRAY_BUFFER, all);
    scene.counts = [outside.length, all.length];
    const places = new Uint16Array(bytes(scene.points).buffer);
    scene.reach = [0, 1, 2].map(i => {
      let end = 0;
      for (let k = i; k < places.length; k += 3) end = Math.max(end, Math.abs(scene.low[i] + scene.unit * places[k]));
      return end;
    });
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, 256, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, bytes(scene.palette));
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    const colours = bytes(scene.palette), stops = [];
    for (let i = 0; i < 256; i += 15) stops.push(`rgb(${colours.slice(3 * i, 3 * i + 3)})`);
    figure.querySelector(".bar").style.background = `linear-gradient(to right, ${stops})`;
    scene.limits.forEach((limit, i) => { figure.querySelectorAll(".limit")[i].textContent = limit; });
  }
  function draw() {
    const scene = state.scene, ratio = Math.min(window.devicePixelRatio || 1, 2);
    canvas.width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    canvas.height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const c = Math.cos(state.spin), s = Math.sin(state.spin), a = Math.cos(state.tilt), b = Math.sin(state.tilt);
    const aspect = canvas.width / canvas.height, reach = Math.hypot(...scene.reach);
    gl.uniformMatrix3fv(uniform("turn"), false, [c, s * a, s * b, -s, c * a, c * b, 0, -b, a]);
    gl.uniform3fv(uniform("low"), scene.low);
    gl.uniform2f(uniform("shift"), state.x * state.zoom, state.y * state.zoom);
    gl.uniform1f(uniform("unit"), scene.unit);
    const size = reach / Math.min(1, aspect) / 1.6 / state.zoom;
    gl.uniform1f(uniform("size"), size);
    gl.uniform1f(uniform("depth"), 0.9 * size / reach);
    gl.uniform1f(uniform("aspect"), aspect);
    const kind = scene.wide ? gl.UNSIGNED_INT : gl.UNSIGNED_SHORT;
    for (const mirror of scene.mirrors) {
      if (state.open && mirror[1] < 0) continue;
      gl.uniform3fv(uniform("mirror"), mirror);
      gl.drawElements(gl.TRIANGLES, scene.counts[state.open ? 1 : 0], kind, 0);
    }
  }
  function turn(spin, tilt) {
    state.spin += spin;
    state.tilt = Math.max(-Math.PI, Math.min(0, state.tilt + tilt));
    draw();
  }
  function move(right, down) {
    const step = 2 / canvas.clientHeight / state.zoom;
    state.x += right * step;
    state.y -= down * step;
    draw();
  }
  function zoom(factor) {
    state.zoom = Math.max(0.5, Math.min(20, state.zoom * factor));
    draw();
  }
  const keys = {
    ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0),
    ArrowUp: () => turn(0, -0.1), ArrowDown: () => turn(0, 0.1),
    "+": () => zoom(1.25), "-": () => zoom(0.8),
  };
  canvas.addEventListener("keydown", event => {
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  });
  canvas.addEventListener("pointerdown", event => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", event => {
    if (!(event.buttons & 1)) return;
    if (event.shiftKey) move(event.movementX, event.movementY);
    else turn(event.movementX / 150, event.movementY / 150);
  });
  canvas.addEventListener("webglcontextlost", () => { figure.classList.remove("works"); });
  find("nearer").addEventListener("click", () => zoom(1.25));
  find("further").addEventListener("click", () => zoom(0.8));
  find("reset").addEventListener("click", () => { Object.assign(state, START); draw(); });
  find("open").addEventListener("change", event => { state.open = event.target.checked; draw(); });
  find("scene").addEventListener("change", event => { load(scenes[event.target.value]); draw(); });
  find("open").parentElement.hidden = !scenes[0].cut;
  figure.classList.add("works");
  load(scenes[0]);
  new ResizeObserver(draw).observe(canvas);
  draw();
}
document.querySelectorAll("figure.view").forEach(view);
