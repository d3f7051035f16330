// Camera that orbits a point and may follow a body; places on its canvas and lines of sight.

import { cross, focal, lookAt, multiply, normalised, perspective, project } from "./matrices.js";

const ANGLE = 0.65;
const FAR_M = 40;

export class Camera {
  constructor(canvas) {
    this.canvas = canvas;
    this.follows = true;
    this.view = { target: [0, 0, 0.05], distance_m: 0.6, yaw_deg: -55, pitch_deg: 25, follow: null, ratio: 10 / 9 };
    this.moved = [0, 0];
  }

  // The view of a drawing, as text; the same one again leaves the camera where it was turned.
  start(initial) {
    if (initial === this.initial) return;
    this.initial = initial;
    this.home();
  }

  home() {
    if (this.initial) this.view = JSON.parse(this.initial);
    this.moved = [0, 0];
  }

  track(poses) {
    const { follow } = this.view;
    if (follow === null || !this.follows) return;
    const position = poses.subarray(7 * follow, 7 * follow + 2);
    if (position.length === 2 && !Number.isNaN(position[0])) this.moved = [position[0], position[1]];
  }

  get target() {
    const [x, y, z] = this.view.target;
    return [x + this.moved[0], y + this.moved[1], z];
  }

  get eye() {
    const yaw = (this.view.yaw_deg * Math.PI) / 180, pitch = (this.view.pitch_deg * Math.PI) / 180, distance_m = this.view.distance_m;
    const target = this.target;
    return [
      target[0] + distance_m * Math.cos(pitch) * Math.cos(yaw),
      target[1] + distance_m * Math.cos(pitch) * Math.sin(yaw),
      target[2] + distance_m * Math.sin(pitch),
    ];
  }

  get matrix() {
    const { clientWidth, clientHeight } = this.canvas, near_m = this.view.distance_m / 60;
    const lens = perspective(ANGLE, clientWidth / clientHeight, this.view.ratio, near_m, FAR_M);
    return multiply(lens, lookAt(this.eye, this.target));
  }

  // Place of a point on the canvas, px; null behind the camera.
  pixelOf(point) {
    const at = project(this.matrix, point), { clientWidth, clientHeight } = this.canvas;
    return at && [(at[0] * 0.5 + 0.5) * clientWidth, (0.5 - at[1] * 0.5) * clientHeight];
  }

  pixelsPerMetre(point) {
    const [x, y, z] = point, view = this.matrix, at = project(view, point), above = project(view, [x, y, z + 0.01]);
    return at && above ? (Math.hypot(at[0] - above[0], at[1] - above[1]) * this.canvas.clientHeight) / 0.02 : 0;
  }

  // Eye (m) and direction of the line of sight through a point of the canvas (px).
  sight(x, y) {
    const target = this.target, eye = this.eye, { clientWidth, clientHeight } = this.canvas, ratio = clientWidth / clientHeight;
    const back = normalised(eye.map((value, i) => value - target[i])), right = normalised(cross([0, 0, 1], back)), up = cross(back, right);
    const f = focal(ANGLE, ratio, this.view.ratio), across = ((2 * x) / clientWidth - 1) * (ratio / f), down = (1 - (2 * y) / clientHeight) / f;
    return [eye, back.map((value, i) => across * right[i] + down * up[i] - value)];
  }

  // Point in a plane above the floor (m) at a point of the canvas (px).
  floorPoint(x, y, height_m) {
    const [eye, ray] = this.sight(x, y), way = (height_m - eye[2]) / Math.min(ray[2], -0.05); // not beyond the horizon
    return [eye[0] + way * ray[0], eye[1] + way * ray[1]];
  }

  turn(x, y) {
    this.view.yaw_deg -= 0.4 * x;
    this.view.pitch_deg = Math.max(-5, Math.min(89, this.view.pitch_deg + 0.3 * y));
  }

  zoom(factor) {
    this.view.distance_m = Math.max(0.15, Math.min(8, this.view.distance_m * factor));
  }

  pan(x, y) {
    const yaw = (this.view.yaw_deg * Math.PI) / 180, step = (ANGLE * this.view.distance_m) / this.canvas.clientHeight;
    this.view.target[0] += step * (Math.sin(yaw) * x - Math.cos(yaw) * y);
    this.view.target[1] += step * (-Math.cos(yaw) * x - Math.sin(yaw) * y);
  }
}
