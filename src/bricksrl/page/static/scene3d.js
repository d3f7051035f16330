// 3D scene in WebGL 2: meshes of bodies, a floor with metres, a sun with shadows, a camera that orbits and follows.
// Column-major matrices, metres, z up. Draws only when asked to.

const VERTEX = `#version 300 es
layout(location = 0) in vec3 point;
layout(location = 1) in vec3 normal;
uniform mat4 view, model, sun;
out vec3 world, facing;
out vec4 lit;
void main() {
  vec4 at = model * vec4(point, 1.0);
  world = at.xyz;
  facing = mat3(model) * normal;
  lit = sun * at;
  gl_Position = view * at;
}`;

const LIGHT = `
uniform highp sampler2DShadow shadows;
uniform vec3 eye, sunward;
in vec3 world, facing;
in vec4 lit;
out vec4 colour;
float sunshine() {
  vec3 at = lit.xyz / lit.w * 0.5 + 0.5;
  if (any(lessThan(at, vec3(0.0))) || any(greaterThan(at, vec3(1.0)))) return 1.0;
  float sum = 0.0;
  for (int i = 0; i < 4; i++) {
    vec2 off = (vec2(i & 1, i >> 1) - 0.5) / 900.0;
    sum += texture(shadows, vec3(at.xy + off, at.z - 0.0015));
  }
  return sum * 0.25;
}`;

const SOLID = `#version 300 es
precision highp float;
uniform vec4 tint;
uniform int pattern;
${LIGHT}
void main() {
  vec3 n = normalize(facing), base = tint.rgb;
  if (pattern == 1 && abs(n.x) > 0.5) {
    float course = floor(world.z / 0.032);
    vec2 at = vec2(world.y / 0.064 + 0.5 * mod(course, 2.0), world.z / 0.032);
    vec2 near = abs(fract(at) - 0.5), width = fwidth(at);
    float joint = max(smoothstep(0.46 - width.x, 0.47 + width.x, near.x), smoothstep(0.42 - width.y, 0.45 + width.y, near.y));
    base *= mix(1.0, 0.72, joint * clamp(0.35 / max(width.x, width.y), 0.0, 1.0));
  }
  float sun = max(dot(n, sunward), 0.0) * sunshine();
  vec3 towards = normalize(eye - world);
  float shine = pow(max(dot(n, normalize(sunward + towards)), 0.0), 40.0) * sun;
  vec3 ambient = mix(vec3(0.42, 0.41, 0.40), vec3(0.60, 0.62, 0.66), n.z * 0.5 + 0.5);
  colour = vec4(base * (ambient + 0.62 * sun) + 0.16 * shine, tint.a);
}`;

const FLOOR = `#version 300 es
precision highp float;
uniform vec3 sky;
${LIGHT}
float lines(vec2 at, float half_width) {
  vec2 width = fwidth(at), near = abs(fract(at - 0.5) - 0.5);
  vec2 line = 1.0 - smoothstep(vec2(half_width), vec2(half_width) + 1.5 * width, near);
  return max(line.x, line.y) * clamp(0.4 / max(width.x, width.y), 0.0, 1.0);
}
void main() {
  vec3 base = vec3(0.88, 0.89, 0.905);
  base = mix(base, vec3(0.78, 0.80, 0.83), 0.7 * lines(world.xy * 10.0, 0.006));
  base = mix(base, vec3(0.50, 0.54, 0.60), 0.8 * lines(world.xy, 0.0022));
  base *= 0.80 + 0.20 * sunshine();
  float far = smoothstep(1.5, 7.0, distance(world.xy, eye.xy));
  colour = vec4(mix(base, sky, far), 1.0);
}`;

const DEPTH = `#version 300 es
precision highp float;
void main() {}`;

const SKY = [0.935, 0.945, 0.96];
const SUNWARD = normalised([-0.32, -0.42, 0.85]);
const SHADOW_PX = 1024;
const SLOW_MS = 40;

export class Scene3D {
  constructor(canvas, labels) {
    this.canvas = canvas;
    this.labels = labels;
    this.gl = canvas.getContext("webgl2", { antialias: true, alpha: false, powerPreference: "low-power" });
    if (!this.gl) throw new Error("this browser has no WebGL 2");
    this.bodies = [];
    this.poses = null;
    this.follows = true;
    this.view = { target: [0, 0, 0.05], distance_m: 0.6, yaw_deg: -55, pitch_deg: 25, follow: null };
    this.moved = [0, 0];
    this.floor = 0;
    this.frames = 0;
    this.wanted = this.busy = false;
    this.detail = 1;
    this.makePrograms();
    this.listen();
    new ResizeObserver(() => this.ask()).observe(canvas);
  }

  makePrograms() {
    const gl = this.gl;
    this.solid = program(gl, VERTEX, SOLID);
    this.ground = program(gl, VERTEX, FLOOR);
    this.depth = program(gl, VERTEX, DEPTH);
    this.shadowMap = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.shadowMap);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT24, SHADOW_PX, SHADOW_PX);
    for (const [name, value] of [
      [gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE],
      [gl.TEXTURE_MIN_FILTER, gl.LINEAR],
      [gl.TEXTURE_MAG_FILTER, gl.LINEAR],
      [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE],
      [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE],
    ]) gl.texParameteri(gl.TEXTURE_2D, name, value);
    this.shadowBuffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadowBuffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, this.shadowMap, 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    const up = [0, 0, 127, 0];
    this.square = mesh(gl, new Float32Array([-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0]), new Int8Array([...up, ...up, ...up, ...up]),
      new Uint32Array([0, 1, 2, 0, 2, 3]));
  }

  // A scene file: length of the header, header, arrays (see scene.py).
  load(buffer) {
    const gl = this.gl, length = new DataView(buffer).getUint32(0, true), start = 4 + length;
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
    for (const one of this.meshes ?? []) one.free();
    this.meshes = header.meshes.map((one) => mesh(gl,
      new Float32Array(buffer, start + one.points, 3 * one.vertices),
      new Int8Array(buffer, start + one.normals, 4 * one.vertices),
      new Uint32Array(buffer, start + one.faces, 3 * one.triangles)));
    this.bodies = header.bodies.map((body) => ({
      name: body.name,
      shapes: body.shapes.map((shape) => ({
        mesh: this.meshes[shape.mesh],
        colour: shape.colour,
        pattern: shape.pattern === "bricks" ? 1 : 0,
        place: rigid(shape.position, shape.wxyz),
      })),
    }));
    this.floor = header.floor;
    this.poses = null;
    if (JSON.stringify(header.view) !== this.start) {
      this.start = JSON.stringify(header.view);
      this.home();
    }
  }

  home() {
    this.view = JSON.parse(this.start ?? JSON.stringify(this.view));
    this.moved = [0, 0];
    this.ask();
  }

  setPoses(poses) {
    this.poses = poses;
    this.ask();
  }

  // Draw soon: never before the picture before is done, and without a graphics card in half of the time at most.
  ask() {
    this.wanted = true;
    if (this.busy) return;
    this.busy = true;
    requestAnimationFrame(() => {
      this.wanted = false;
      const started = performance.now();
      this.draw();
      const fence = this.gl.fenceSync(this.gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
      this.gl.flush();
      const look = () => {
        if (fence && this.gl.getSyncParameter(fence, this.gl.SYNC_STATUS) !== this.gl.SIGNALED && !this.gl.isContextLost()) {
          setTimeout(look, 4);
          return;
        }
        this.gl.deleteSync(fence);
        const took = performance.now() - started;
        this.adapt(took);
        setTimeout(() => {
          this.busy = false;
          if (this.wanted) this.ask();
        }, took > SLOW_MS ? took : 0);
      };
      setTimeout(look, 0);
    });
  }

  // Fewer pixels where drawing is slow, more again where it is quick.
  adapt(took) {
    this.took = 0.8 * (this.took ?? took) + 0.2 * took;
    this.canvas.dataset.took = this.took.toFixed(0);
    if (this.took > 2 * SLOW_MS) this.detail = Math.max(0.35, this.detail * Math.max(0.6, Math.sqrt((2 * SLOW_MS) / this.took)));
    else if (this.took < SLOW_MS / 2) this.detail = Math.min(1, this.detail * 1.02);
  }

  draw() {
    const gl = this.gl, canvas = this.canvas, scale = this.detail * Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.round(canvas.clientWidth * scale), height = Math.round(canvas.clientHeight * scale);
    if (!width || !height || !this.poses || gl.isContextLost()) return;
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    this.frames += 1;
    canvas.dataset.frames = this.frames;
    const target = this.target(), eye = this.eye(target);
    const view = multiply(perspective(0.65, width / height, this.view.distance_m / 60, 40), lookAt(eye, target));
    const reach = Math.max(0.45, Math.min(1.2, this.view.distance_m));
    const sunEye = target.map((value, i) => value + 3 * SUNWARD[i]);
    const sun = multiply(orthographic(reach, 1.0, 5.0), lookAt(sunEye, target));
    const placed = this.place();
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.CULL_FACE);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadowBuffer);
    gl.viewport(0, 0, SHADOW_PX, SHADOW_PX);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.useProgram(this.depth.id);
    gl.uniformMatrix4fv(this.depth.at("view"), false, sun);
    for (const one of placed) {
      gl.uniformMatrix4fv(this.depth.at("model"), false, one.model);
      one.shape.mesh.draw();
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    gl.clearColor(...SKY, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    this.paint(this.solid, view, sun, eye);
    const clear = placed.filter((one) => one.shape.colour[3] < 1);
    for (const one of placed) if (one.shape.colour[3] >= 1) this.drawShape(one);
    if (this.floor !== null) this.drawFloor(view, sun, eye, target);
    if (clear.length) {
      this.paint(this.solid, view, sun, eye);
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
      for (const one of clear) this.drawShape(one);
      gl.disable(gl.BLEND);
    }
    this.writeMetres(view, target);
  }

  paint(which, view, sun, eye) {
    const gl = this.gl;
    gl.useProgram(which.id);
    gl.uniformMatrix4fv(which.at("view"), false, view);
    gl.uniformMatrix4fv(which.at("sun"), false, sun);
    gl.uniform3fv(which.at("eye"), eye);
    gl.uniform3fv(which.at("sunward"), SUNWARD);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.shadowMap);
    gl.uniform1i(which.at("shadows"), 0);
  }

  drawShape({ shape, model }) {
    const gl = this.gl;
    gl.uniformMatrix4fv(this.solid.at("model"), false, model);
    gl.uniform4fv(this.solid.at("tint"), shape.colour);
    gl.uniform1i(this.solid.at("pattern"), shape.pattern);
    shape.mesh.draw();
  }

  drawFloor(view, sun, eye, target) {
    const gl = this.gl, size = 12;
    this.paint(this.ground, view, sun, eye);
    gl.uniform3fv(this.ground.at("sky"), SKY);
    gl.uniformMatrix4fv(this.ground.at("model"), false,
      new Float32Array([size, 0, 0, 0, 0, size, 0, 0, 0, 0, 1, 0, target[0], target[1], this.floor, 1]));
    this.square.draw();
  }

  // Each shape with its place in the world; a body whose x is no number is hidden.
  place() {
    const placed = [];
    this.bodies.forEach((body, i) => {
      const pose = this.poses.subarray(7 * i, 7 * i + 7);
      if (pose.length < 7 || Number.isNaN(pose[0])) return;
      const frame = rigid(pose, pose.subarray(3));
      for (const shape of body.shapes) placed.push({ shape, model: multiply(frame, shape.place) });
    });
    return placed;
  }

  target() {
    const { follow, target } = this.view;
    if (follow === null || !this.poses || !this.follows) return [target[0] + this.moved[0], target[1] + this.moved[1], target[2]];
    const at = this.poses.subarray(7 * follow, 7 * follow + 2);
    if (at.length === 2 && !Number.isNaN(at[0])) this.moved = [at[0], at[1]];
    return [target[0] + this.moved[0], target[1] + this.moved[1], target[2]];
  }

  eye(target) {
    const yaw = (this.view.yaw_deg * Math.PI) / 180, pitch = (this.view.pitch_deg * Math.PI) / 180, far = this.view.distance_m;
    return [
      target[0] + far * Math.cos(pitch) * Math.cos(yaw),
      target[1] + far * Math.cos(pitch) * Math.sin(yaw),
      target[2] + far * Math.sin(pitch),
    ];
  }

  // Marks on the floor, a label at each whole metre near the robot.
  writeMetres(view, target) {
    const marks = [];
    if (this.floor !== null) {
      for (let x = Math.round(target[0]) - 2; x <= Math.round(target[0]) + 2; x++) marks.push([[x, Math.round(target[1])], `${x} m`]);
    }
    while (this.labels.childElementCount < marks.length) this.labels.append(document.createElement("span"));
    [...this.labels.children].forEach((label, i) => {
      const at = marks[i] && project(view, [...marks[i][0], this.floor]);
      const isBelow = marks[i] && distance(marks[i][0], target) < 0.3; // the robot stands there
      label.hidden = !at || isBelow || Math.abs(at[0]) > 1 || Math.abs(at[1]) > 1;
      if (label.hidden) return;
      label.textContent = marks[i][1];
      label.style.left = `${(at[0] * 0.5 + 0.5) * 100}%`;
      label.style.top = `${(0.5 - at[1] * 0.5) * 100}%`;
    });
  }

  // One finger or the left button turns, two fingers or another button move, wheel and pinch zoom, a double click goes home.
  listen() {
    const canvas = this.canvas, down = new Map();
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("dblclick", () => this.home());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(event.deltaY * 0.001));
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      down.set(event.pointerId, [event.clientX, event.clientY]);
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => down.delete(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      const before = down.get(event.pointerId);
      if (!before) return;
      const now = [event.clientX, event.clientY], by = [now[0] - before[0], now[1] - before[1]];
      if (down.size === 2) {
        const other = [...down].find(([id]) => id !== event.pointerId)[1];
        this.zoom(distance(before, other) / Math.max(1, distance(now, other)));
        this.pan(by[0] / 2, by[1] / 2);
      } else if (event.buttons > 1 || event.shiftKey) this.pan(...by);
      else this.turn(...by);
      down.set(event.pointerId, now);
    });
  }

  turn(x, y) {
    this.view.yaw_deg -= 0.4 * x;
    this.view.pitch_deg = Math.max(-5, Math.min(89, this.view.pitch_deg + 0.3 * y));
    this.ask();
  }

  zoom(factor) {
    this.view.distance_m = Math.max(0.15, Math.min(8, this.view.distance_m * factor));
    this.ask();
  }

  pan(x, y) {
    const yaw = (this.view.yaw_deg * Math.PI) / 180, step = (0.65 * this.view.distance_m) / this.canvas.clientHeight;
    this.view.target[0] += step * (Math.sin(yaw) * x - Math.cos(yaw) * y);
    this.view.target[1] += step * (-Math.cos(yaw) * x - Math.sin(yaw) * y);
    this.ask();
  }
}

function program(gl, vertex, fragment) {
  const id = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(id, shader);
  }
  gl.linkProgram(id);
  if (!gl.getProgramParameter(id, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(id));
  const places = new Map();
  const at = (name) => {
    if (!places.has(name)) places.set(name, gl.getUniformLocation(id, name));
    return places.get(name);
  };
  return { id, at };
}

function mesh(gl, points, normals, faces) {
  const array = gl.createVertexArray(), buffers = [points, normals, faces].map(() => gl.createBuffer());
  gl.bindVertexArray(array);
  gl.bindBuffer(gl.ARRAY_BUFFER, buffers[0]);
  gl.bufferData(gl.ARRAY_BUFFER, points, gl.STATIC_DRAW);
  gl.enableVertexAttribArray(0);
  gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
  gl.bindBuffer(gl.ARRAY_BUFFER, buffers[1]);
  gl.bufferData(gl.ARRAY_BUFFER, normals, gl.STATIC_DRAW);
  gl.enableVertexAttribArray(1);
  gl.vertexAttribPointer(1, 3, gl.BYTE, true, 4, 0);
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffers[2]);
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
  gl.bindVertexArray(null);
  return {
    draw() {
      gl.bindVertexArray(array);
      gl.drawElements(gl.TRIANGLES, faces.length, gl.UNSIGNED_INT, 0);
    },
    free() {
      gl.deleteVertexArray(array);
      buffers.forEach((one) => gl.deleteBuffer(one));
    },
  };
}

function rigid([x, y, z], [w, a, b, c]) {
  return new Float32Array([
    1 - 2 * (b * b + c * c), 2 * (a * b + w * c), 2 * (a * c - w * b), 0,
    2 * (a * b - w * c), 1 - 2 * (a * a + c * c), 2 * (b * c + w * a), 0,
    2 * (a * c + w * b), 2 * (b * c - w * a), 1 - 2 * (a * a + b * b), 0,
    x, y, z, 1,
  ]);
}

function multiply(first, second) {
  const out = new Float32Array(16);
  for (let column = 0; column < 4; column++) {
    for (let row = 0; row < 4; row++) {
      let sum = 0;
      for (let i = 0; i < 4; i++) sum += first[4 * i + row] * second[4 * column + i];
      out[4 * column + row] = sum;
    }
  }
  return out;
}

function perspective(angle, ratio, near, far) {
  // Of a narrow screen the angle is that of its width, so that a phone shows as much.
  const f = (1 / Math.tan(angle / 2)) * Math.min(1, ratio * 0.9);
  return new Float32Array([f / ratio, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0]);
}

function orthographic(half, near, far) {
  return new Float32Array([1 / half, 0, 0, 0, 0, 1 / half, 0, 0, 0, 0, 2 / (near - far), 0, 0, 0, (far + near) / (near - far), 1]);
}

function lookAt(eye, target) {
  const back = normalised(eye.map((value, i) => value - target[i]));
  const right = normalised(cross(Math.abs(back[2]) > 0.9999 ? [0, 1, 0] : [0, 0, 1], back)), up = cross(back, right);
  const by = (axis) => -(axis[0] * eye[0] + axis[1] * eye[1] + axis[2] * eye[2]);
  return new Float32Array([right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0, by(right), by(up), by(back), 1]);
}

function project(view, [x, y, z]) {
  const at = (row) => view[row] * x + view[4 + row] * y + view[8 + row] * z + view[12 + row], w = at(3);
  return w > 0 ? [at(0) / w, at(1) / w] : null;
}

function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

function normalised(v) {
  const length = Math.hypot(...v);
  return v.map((value) => value / length);
}

function distance(a, b) {
  return Math.hypot(a[0] - b[0], a[1] - b[1]);
}
