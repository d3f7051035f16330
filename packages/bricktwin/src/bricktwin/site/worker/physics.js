// Physics of a robot in its world, and the poses of what is drawn.

import { Engine } from "./engine.js";
import { Frames } from "./view/frames.js";

export class Physics {
  // `mujoco`: the loaded module; `file`: a robot's file.
  constructor(mujoco, file) {
    this.mujoco = mujoco;
    this.engine = new Engine(mujoco, file.robot);
    this.frames = new Frames(file.drawing);
    // A state of its own, as what is looked at must not change what happens.
    this.drawn = new mujoco.MjData(this.engine.model);
  }

  // Poses of the drawing's bodies as they are now.
  poses() {
    const { mujoco, drawn } = this, { model, data } = this.engine;
    for (const name of ["qpos", "mocap_pos", "mocap_quat"]) if (data[name].length) drawn[name].set(data[name]);
    mujoco.mj_kinematics(model, drawn);
    return this.frames.poses(drawn);
  }

  end() {
    this.drawn.delete();
    this.engine.end();
  }
}
