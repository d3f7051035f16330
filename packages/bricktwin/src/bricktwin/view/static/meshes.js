// Meshes on the graphics card, and where they are.

// What is nowhere further from the floor lies on it: tape, a mat, a mark.
export const FLAT_M = 0.003;

export function makeMesh(gl, points, normals, faces) {
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
    box: boundsOf(points),
    draw() {
      gl.bindVertexArray(array);
      gl.drawElements(gl.TRIANGLES, faces.length, gl.UNSIGNED_INT, 0);
    },
    free() {
      gl.deleteVertexArray(array);
      buffers.forEach((buffer) => gl.deleteBuffer(buffer));
    },
  };
}

// Smallest and largest coordinates of points.
function boundsOf(points) {
  const low = [Infinity, Infinity, Infinity], high = low.map((value) => -value);
  points.forEach((value, i) => {
    low[i % 3] = Math.min(low[i % 3], value);
    high[i % 3] = Math.max(high[i % 3], value);
  });
  return { low, high };
}

// Height of the upper side of a placed shape above the floor, infinite if it lies further above or below.
export function topOf({ shape, model }, floor) {
  const { low, high } = shape.mesh.box;
  let [bottom, top] = [model[14] - floor, model[14] - floor];
  for (let axis = 0; axis < 3; axis++) {
    const rise = model[4 * axis + 2];
    bottom += Math.min(rise * low[axis], rise * high[axis]);
    top += Math.max(rise * low[axis], rise * high[axis]);
  }
  return bottom > -FLAT_M && top < FLAT_M ? top : Infinity;
}

// Way along a ray to a box in a frame, infinite if it misses: the ray is between both sides of each axis at once.
export function wayTo({ low, high }, frame, eye, ray) {
  let [from, to] = [0, Infinity];
  for (let axis = 0; axis < 3; axis++) {
    const along = (v) => frame[4 * axis] * v[0] + frame[4 * axis + 1] * v[1] + frame[4 * axis + 2] * v[2];
    const start = along(eye.map((value, i) => value - frame[12 + i])), speed = along(ray) || 1e-9;
    const sides = [(low[axis] - start) / speed, (high[axis] - start) / speed];
    [from, to] = [Math.max(from, Math.min(...sides)), Math.min(to, Math.max(...sides))];
  }
  return from < to ? from : Infinity;
}
