// Frames of a drawing from what MuJoCo's JavaScript build computes: needs no page, so a worker may use it.

export class Frames {
  // `drawing`: as bricktwin.view.drawing_of_body describes it.
  constructor(drawing) {
    this.numbers = drawing.bodies.map((body) => body.model_body);
    this.places = new Map(this.numbers.map((number, place) => [number, place]));
    this.spinners = drawing.spinners.filter(({ body }) => this.places.has(body));
    this.rods = drawing.rods.filter(({ body }) => this.places.has(body));
  }

  // Poses of all bodies: seven float32 each, x, y, z (m), and the quaternion w, x, y, z. `data`: MuJoCo's arrays of these names after
  // `mj_kinematics`, taken anew, as they move when memory grows.
  poses({ xpos, xquat, qpos, site_xpos }) {
    const poses = new Float32Array(7 * this.numbers.length);
    this.numbers.forEach((number, place) => {
      if (number === null) {
        poses[7 * place] = NaN;
        return;
      }
      poses.set(xpos.subarray(3 * number, 3 * number + 3), 7 * place);
      poses.set(xquat.subarray(4 * number, 4 * number + 4), 7 * place + 3);
    });
    for (const { body, parent, address, start_rad, ratio, axis } of this.spinners) {
      const half_rad = (ratio * (qpos[address] - start_rad)) / 2, sine = Math.sin(half_rad);
      this.turn(poses, xquat, body, parent, [Math.cos(half_rad), ...axis.map((value) => value * sine)]);
    }
    for (const { body, parent, far_site } of this.rods) {
      const along = [0, 1, 2].map((i) => site_xpos[3 * far_site + i] - xpos[3 * body + i]);
      this.turn(poses, xquat, body, parent, turnToZ(inFrame(xquat.subarray(4 * parent, 4 * parent + 4), along)));
    }
    return poses;
  }

  // A body that is turned in its parent's frame.
  turn(poses, xquat, body, parent, turned) {
    poses.set(product(xquat.subarray(4 * parent, 4 * parent + 4), turned), 7 * this.places.get(body) + 3);
  }
}

function product([a, b, c, d], [w, x, y, z]) {
  return [
    a * w - b * x - c * y - d * z,
    a * x + b * w + c * z - d * y,
    a * y - b * z + c * w + d * x,
    a * z + b * y - c * x + d * w,
  ];
}

// A vector in the frame of a quaternion.
function inFrame([w, x, y, z], vector) {
  return product(product([w, -x, -y, -z], [0, ...vector]), [w, x, y, z]).slice(1);
}

// Shortest turn of the z axis to a direction.
function turnToZ([x, y, z]) {
  const length = Math.hypot(x, y, z), half = Math.hypot(1 + z / length, x / length, y / length);
  if (half < 1e-9) return [0, 1, 0, 0];
  return [(1 + z / length) / half, -y / length / half, x / length / half, 0];
}
