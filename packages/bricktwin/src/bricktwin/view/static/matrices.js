// Matrices, column-major, and vectors of three numbers.

export function rigid([x, y, z], [w, a, b, c]) {
  return new Float32Array([
    1 - 2 * (b * b + c * c), 2 * (a * b + w * c), 2 * (a * c - w * b), 0,
    2 * (a * b - w * c), 1 - 2 * (a * a + c * c), 2 * (b * c + w * a), 0,
    2 * (a * c + w * b), 2 * (b * c - w * a), 1 - 2 * (a * a + b * b), 0,
    x, y, z, 1,
  ]);
}

export function multiply(first, second) {
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

// On a narrow screen the angle is that of its width, so that a phone shows as much as a wide screen.
export function focal(angle, ratio, seenRatio) {
  return (1 / Math.tan(angle / 2)) * Math.min(1, ratio / seenRatio);
}

export function perspective(angle, ratio, seenRatio, near, far) {
  const f = focal(angle, ratio, seenRatio);
  return new Float32Array([f / ratio, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0]);
}

export function orthographic(half, near, far) {
  return new Float32Array([1 / half, 0, 0, 0, 0, 1 / half, 0, 0, 0, 0, 2 / (near - far), 0, 0, 0, (far + near) / (near - far), 1]);
}

export function lookAt(eye, target) {
  const back = normalised(eye.map((value, i) => value - target[i]));
  const right = normalised(cross(Math.abs(back[2]) > 0.9999 ? [0, 1, 0] : [0, 0, 1], back)), up = cross(back, right);
  const shift = (axis) => -(axis[0] * eye[0] + axis[1] * eye[1] + axis[2] * eye[2]);
  return new Float32Array([right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0, shift(right), shift(up), shift(back), 1]);
}

export function project(view, [x, y, z]) {
  const component = (row) => view[row] * x + view[4 + row] * y + view[8 + row] * z + view[12 + row], w = component(3);
  return w > 0 ? [component(0) / w, component(1) / w] : null;
}

export function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

export function normalised(v) {
  const length = Math.hypot(...v);
  return v.map((value) => value / length);
}

export function distance(a, b) {
  return Math.hypot(a[0] - b[0], a[1] - b[1]);
}
