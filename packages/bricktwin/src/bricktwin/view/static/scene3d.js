// 3D scene in WebGL 2: meshes of bodies, a floor with marks of metres, a sun with shadows, a camera that orbits and follows.
// Metres, z up. Draws only on request. It needs a canvas, and an element for the labels of the marks, and nothing else of a page.

import { Camera } from "./camera.js";
import { arraysOf, bytesOf } from "./drawing_file.js";
import { listen } from "./gestures.js";
import { lookAt, multiply, normalised, orthographic, rigid } from "./matrices.js";
import { FLAT_M, makeMesh, topOf, wayTo } from "./meshes.js";
import { writeMetres } from "./metres.js";
import { Pacing } from "./pacing.js";
import { DEPTH, FLOOR, SOLID, VERTEX, makeProgram } from "./shaders.js";
import { makeTexture } from "./textures.js";

const SKY = [0.935, 0.945, 0.96];
const SUNWARD = normalised([-0.32, -0.42, 0.85]);
const SHADOW_PX = 1024;

export class Scene3D {
  constructor(canvas, labels) {
    this.canvas = canvas;
    this.labels = labels;
    this.gl = canvas.getContext("webgl2", { antialias: true, alpha: false, stencil: true, powerPreference: "low-power" });
    if (!this.gl) throw new Error("this browser has no WebGL 2");
    this.camera = new Camera(canvas);
    this.pacing = new Pacing(this.gl, (resolution) => this.draw(resolution));
    this.bodies = [];
    this.meshes = [];
    this.textures = [];
    this.poses = null;
    this.floor = 0;
    this.frames = 0;
    this.makePrograms();
    listen(this);
    new ResizeObserver(() => this.requestDraw()).observe(canvas);
  }

  makePrograms() {
    const gl = this.gl;
    this.solid = makeProgram(gl, VERTEX, SOLID);
    this.ground = makeProgram(gl, VERTEX, FLOOR);
    this.depth = makeProgram(gl, VERTEX, DEPTH);
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
    this.square = makeMesh(gl, new Float32Array([-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0]), new Int8Array([...up, ...up, ...up, ...up]),
      new Uint32Array([0, 1, 2, 0, 2, 3]));
  }

  // A drawing, as bricktwin.view.drawing_of_body describes it.
  load(drawing) {
    const gl = this.gl;
    for (const old of [...this.meshes, ...this.textures]) old.free();
    this.meshes = drawing.meshes.map((mesh) => makeMesh(gl, ...arraysOf(mesh)));
    this.textures = drawing.pictures.map((picture) => makeTexture(gl, bytesOf(picture), () => this.requestDraw()));
    this.bodies = drawing.bodies.map((body) => ({
      isMovable: body.model_body > 0,
      shapes: body.shapes.map((shape) => ({
        mesh: this.meshes[shape.mesh],
        colour: shape.colour,
        pattern: shape.pattern === "bricks" ? 1 : 0,
        texture: this.textures[shape.picture] ?? null,
        transform: rigid(shape.position, shape.wxyz),
      })),
    }));
    this.floor = drawing.floor;
    this.poses = null;
    this.camera.start(JSON.stringify(drawing.view));
    this.requestDraw();
  }

  home() {
    this.camera.home();
    this.requestDraw();
  }

  // Whether the camera goes with the body that the drawing's view names.
  set follows(is) {
    this.camera.follows = is;
    this.requestDraw();
  }

  // A frame: seven numbers for each body, position and quaternion (w, x, y, z); an x that is not a number hides the body.
  setPoses(poses) {
    const isNew = !this.poses || poses.some((value, i) => value !== this.poses[i]);
    this.poses = poses;
    if (isNew) this.requestDraw();
  }

  requestDraw() {
    this.pacing.request();
  }

  draw(resolution) {
    const gl = this.gl, canvas = this.canvas, scale = resolution * Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.round(canvas.clientWidth * scale), height = Math.round(canvas.clientHeight * scale);
    // Poses may come before the scene: an empty floor would say that the robot is gone.
    if (!width || !height || !this.poses || !this.bodies.length || gl.isContextLost()) return;
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    this.frames += 1;
    canvas.dataset.frames = this.frames;
    this.camera.track(this.poses);
    const { target, eye, matrix: view } = this.camera;
    const reach = Math.max(0.45, Math.min(1.2, this.camera.view.distance_m));
    const sunEye = target.map((value, i) => value + 3 * SUNWARD[i]);
    const sun = multiply(orthographic(reach, 1.0, 5.0), lookAt(sunEye, target));
    const { opaque, transparent, flat } = this.sortedShapes();
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.CULL_FACE);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadowBuffer);
    gl.viewport(0, 0, SHADOW_PX, SHADOW_PX);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.useProgram(this.depth.id);
    gl.uniformMatrix4fv(this.depth.uniform("view"), false, sun);
    for (const { shape, model } of opaque) {
      gl.uniformMatrix4fv(this.depth.uniform("model"), false, model);
      shape.mesh.draw();
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    gl.clearColor(...SKY, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    this.useProgram(this.solid, view, sun, eye);
    for (const placed of opaque) this.drawShape(placed);
    if (this.floor !== null) this.drawFloor(view, sun, eye, target, flat);
    if (transparent.length) {
      this.useProgram(this.solid, view, sun, eye);
      gl.colorMask(false, false, false, false); // first the depths: only what is in front is then blended
      for (const placed of transparent) this.drawShape(placed);
      gl.colorMask(true, true, true, true);
      gl.depthFunc(gl.LEQUAL);
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
      for (const placed of transparent) this.drawShape(placed);
      gl.disable(gl.BLEND);
      gl.depthFunc(gl.LESS);
    }
    writeMetres(this.labels, view, target, this.floor);
  }

  useProgram(program, view, sun, eye) {
    const gl = this.gl;
    gl.useProgram(program.id);
    gl.uniformMatrix4fv(program.uniform("view"), false, view);
    gl.uniformMatrix4fv(program.uniform("sun"), false, sun);
    gl.uniform3fv(program.uniform("eye"), eye);
    gl.uniform3fv(program.uniform("sunward"), SUNWARD);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.shadowMap);
    gl.uniform1i(program.uniform("shadows"), 0);
  }

  // The picture on a shape, from the lowest to the highest corner of its mesh.
  useTexture({ mesh, texture }) {
    const gl = this.gl, isThere = texture !== null && texture.isReady;
    gl.uniform1i(this.solid.uniform("has_picture"), isThere ? 1 : 0);
    gl.uniform1i(this.solid.uniform("picture"), 1);
    if (!isThere) return;
    const { low, high } = mesh.box;
    gl.uniform4f(this.solid.uniform("picture_at"), low[0], low[1], high[0] - low[0], high[1] - low[1]);
    texture.use(gl.TEXTURE1);
  }

  drawShape({ shape, model }) {
    const gl = this.gl;
    gl.uniformMatrix4fv(this.solid.uniform("model"), false, model);
    gl.uniform4fv(this.solid.uniform("tint"), shape.colour);
    gl.uniform1i(this.solid.uniform("pattern"), shape.pattern);
    this.useTexture(shape);
    shape.mesh.draw();
  }

  // The floor, and what lies on it, painted in layers where the floor is seen: between layers that are a hair apart, depths of a
  // graphics card, or of a processor in place of one, say nothing.
  drawFloor(view, sun, eye, target, flat) {
    const gl = this.gl, size = 12;
    gl.enable(gl.STENCIL_TEST);
    gl.stencilFunc(gl.ALWAYS, 1, 1);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.REPLACE);
    this.useProgram(this.ground, view, sun, eye);
    gl.uniform3fv(this.ground.uniform("sky"), SKY);
    gl.uniformMatrix4fv(this.ground.uniform("model"), false,
      new Float32Array([size, 0, 0, 0, 0, size, 0, 0, 0, 0, 1, 0, target[0], target[1], this.floor, 1]));
    this.square.draw();
    gl.stencilFunc(gl.EQUAL, 1, 1);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.KEEP);
    gl.disable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    this.useProgram(this.solid, view, sun, eye);
    for (const placed of flat) this.drawShape(placed);
    gl.disable(gl.BLEND);
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.STENCIL_TEST);
  }

  // Shapes by how they are drawn; the flat ones lie on the floor, the lowest first.
  sortedShapes() {
    const sorted = { opaque: [], transparent: [], flat: [] };
    for (const placed of this.placedShapes()) {
      placed.top_m = this.floor === null ? Infinity : topOf(placed, this.floor);
      const kind = placed.top_m < FLAT_M ? "flat" : placed.shape.colour[3] < 1 ? "transparent" : "opaque";
      sorted[kind].push(placed);
    }
    sorted.flat.sort((a, b) => a.top_m - b.top_m);
    return sorted;
  }

  // Each shape with its matrix in the world; a body whose x is not a number is hidden.
  placedShapes() {
    const shapes = [];
    this.bodies.forEach((body, i) => {
      const pose = this.poses.subarray(7 * i, 7 * i + 7);
      if (pose.length < 7 || Number.isNaN(pose[0])) return;
      const frame = rigid(pose, pose.subarray(3));
      for (const shape of body.shapes) shapes.push({ shape, model: multiply(frame, shape.transform) });
    });
    return shapes;
  }

  // Number of the body near a point of the canvas (px), or else of that which is seen there, such as a wall; -1 if there is none.
  bodyAt(x, y) {
    const near_px = 0.07 * this.camera.pixelsPerMetre(this.camera.target);
    let [best, nearest_px] = [-1, Math.max(22, near_px)];
    const [eye, ray] = this.camera.sight(x, y);
    let [seen, nearest_m] = [-1, Infinity];
    this.bodies.forEach(({ isMovable, shapes }, i) => {
      if (!isMovable || !this.poses) return;
      const at = this.pixelOf(i), away_px = at ? Math.hypot(at[0] - x, at[1] - y) : Infinity;
      if (away_px < nearest_px) [best, nearest_px] = [i, away_px];
      const pose = this.poses.subarray(7 * i, 7 * i + 7), frame = rigid(pose, pose.subarray(3));
      for (const { mesh, transform } of shapes) {
        const way_m = wayTo(mesh.box, multiply(frame, transform), eye, ray);
        if (way_m < nearest_m) [seen, nearest_m] = [i, way_m];
      }
    });
    return best < 0 ? seen : best;
  }

  // Place of a body on the canvas, px.
  pixelOf(body) {
    const point = this.poses.subarray(7 * body, 7 * body + 3);
    return Number.isNaN(point[0]) ? null : this.camera.pixelOf(point);
  }

  // What moves is pulled where `onPull` is set, with a body's number and a point, or null when it is let go.
  pull(body, x, y) {
    this.onPull(body, this.camera.floorPoint(x, y, this.poses[7 * body + 2]), this.pixelOf(body), [x, y]);
  }
}
