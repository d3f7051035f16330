// Engine of MuJoCo's JavaScript build, under the body that Python computes; its other half is tab/js_engine.py.
//
// The state that a body reads and writes lies in Python's memory. One call takes over what Python has written, steps, and
// brings back what has changed: a call between the two languages costs as much as a step of a small robot.

const TYPES = { body: "mjOBJ_BODY", joint: "mjOBJ_JOINT", geom: "mjOBJ_GEOM", site: "mjOBJ_SITE", actuator: "mjOBJ_ACTUATOR", sensor: "mjOBJ_SENSOR" };
const COUNTS = { body: "nbody", joint: "njnt", geom: "ngeom", site: "nsite", actuator: "nu", sensor: "nsensor" };
const GROUPS = 6, IN_OWN_AXES = 1;
// What Python may write, and what it reads after a step.
const WRITTEN = ["qpos", "qvel", "ctrl", "mocap_pos", "xfrc_applied", "gravity"];
const READ = ["qpos", "qvel", "qacc", "actuator_force", "sensordata"];
const SHARED = [...new Set([...WRITTEN, ...READ])];

export class Engine {
  // `mujoco`: the loaded module; `file`: a robot's file, with MJCF text and fields that are more exact than the text, or pieces of them.
  constructor(mujoco, file) {
    this.mujoco = mujoco;
    this.model = mujoco.MjModel.from_xml_string(file.mjcf);
    for (const [name, values] of Object.entries(file.fields ?? {})) this.set(name, values);
    for (const [name, first, values] of file.pieces ?? []) this.model[name].set(values, first);
    this.data = new mujoco.MjData(this.model);
    this.site = mujoco.mjtObj.mjOBJ_SITE.value;
    this.geom = new mujoco.IntBuffer(1);
    this.normal = new mujoco.DoubleBuffer(3);
    this.motion = new mujoco.DoubleBuffer(6);
    this.views = {};
    this.memory = null;
    this.circuits = this.model.opt.disableactuator;
  }

  // ---------------------------------------------------------------- the model

  names(kind) {
    const type = this.mujoco.mjtObj[TYPES[kind]].value;
    return Array.from({ length: this.model[COUNTS[kind]] }, (_, index) => this.mujoco.mj_id2name(this.model, type, index) ?? "");
  }

  index(kind, name) {
    return this.mujoco.mj_name2id(this.model, this.mujoco.mjtObj[TYPES[kind]].value, name);
  }

  field(name) {
    return this.model[name].slice();
  }

  set(name, values) {
    const field = this.model[name];
    if (field?.length !== values.length) throw new Error(`the model has no ${values.length} numbers ${name}; make the site anew`);
    field.set(values);
  }

  deriveConstants() {
    this.push();
    // In data that nobody uses: MuJoCo sets all positions for it.
    const unused = new this.mujoco.MjData(this.model);
    this.mujoco.mj_setConst(this.model, unused);
    unused.delete();
  }

  // ---------------------------------------------------------------- shared memory

  // Number of values of each shared field, by name.
  sizes() {
    return Object.fromEntries(SHARED.map((name) => [name, this.view(name).length]));
  }

  // Share memory: `numbers` is Python's array of all shared fields, one after the other in the order of their sizes.
  share(numbers) {
    this.numbers = numbers;
    this.places = {};
    let place = 0;
    for (const [name, size] of Object.entries(this.sizes())) {
      this.places[name] = place;
      place += size;
    }
    this.pull(SHARED);
  }

  // A field of the data, which is at another place after MuJoCo's memory has grown; to ask MuJoCo each time takes longer.
  view(name) {
    let view = this.views[name];
    if (!view || view.buffer.byteLength === 0) view = this.views[name] = name === "gravity" ? this.model.opt.gravity : this.data[name];
    return view;
  }

  // Python's array, which is at another place after Python's memory has grown.
  shared() {
    if (!this.memory?.data.length) {
      this.memory?.release();
      this.memory = this.numbers.getBuffer("f64");
    }
    return this.memory.data;
  }

  push() {
    const shared = this.shared();
    for (const name of WRITTEN) {
      const view = this.view(name), place = this.places[name];
      for (let index = 0; index < view.length; index++) view[index] = shared[place + index];
    }
  }

  pull(names) {
    const shared = this.shared();
    for (const name of names) {
      const view = this.view(name), place = this.places[name];
      for (let index = 0; index < view.length; index++) shared[place + index] = view[index];
    }
  }

  // ---------------------------------------------------------------- time

  step(count, circuits) {
    if (circuits !== this.circuits) this.model.opt.disableactuator = this.circuits = circuits;
    this.push();
    const { mujoco, model, data } = this;
    for (let step = 0; step < count; step++) mujoco.mj_step(model, data);
    this.pull(READ);
  }

  forward(circuits) {
    this.model.opt.disableactuator = this.circuits = circuits;
    this.push();
    this.mujoco.mj_forward(this.model, this.data);
    this.pull(READ);
  }

  kinematics() {
    this.push();
    this.mujoco.mj_kinematics(this.model, this.data);
    this.mujoco.mj_comPos(this.model, this.data);
  }

  forget() {
    this.data.qacc_warmstart.fill(0);
  }

  // ---------------------------------------------------------------- what follows from the state

  derived(name) {
    return this.data[name].slice();
  }

  // Distance, geometry and normal of what a ray meets; nothing if there is none. `groups`: a bit for each.
  ray(x, y, z, towardsX, towardsY, towardsZ, groups, butBody) {
    const flags = Array.from({ length: GROUPS }, (_, group) => (groups >> group) & 1);
    const distance = this.mujoco.mj_ray(
      this.model, this.data, [x, y, z], [towardsX, towardsY, towardsZ], flags, true, butBody, this.geom, this.normal,
    );
    if (distance < 0) return undefined;
    return [distance, this.geom.GetView()[0], ...this.normal.GetView()];
  }

  // Two geometries and the distance of each contact.
  touches() {
    const contacts = this.data.contact, found = [];
    for (let index = 0; index < contacts.size(); index++) {
      const contact = contacts.get(index);
      found.push([contact.geom[0], contact.geom[1], contact.dist]);
      contact.delete();
    }
    contacts.delete();
    return found;
  }

  siteSpin(site) {
    this.mujoco.mj_objectVelocity(this.model, this.data, this.site, site, this.motion, IN_OWN_AXES);
    return Array.from(this.motion.GetView().subarray(0, 3));
  }

  siteForce(site) {
    // A step computes the accelerations of bodies only if a sensor of the model needs them.
    this.mujoco.mj_rnePostConstraint(this.model, this.data);
    this.mujoco.mj_objectAcceleration(this.model, this.data, this.site, site, this.motion, IN_OWN_AXES);
    return Array.from(this.motion.GetView().subarray(3, 6));
  }

  // Give MuJoCo's memory back; the engine is of no use any more.
  end() {
    this.memory?.release();
    for (const part of [this.data, this.model, this.geom, this.normal, this.motion]) part.delete();
  }
}
