// Stage: the chosen robot in its world, drawn at once from its file, then as the run's frames say.

import { fetchPacked } from "./packed.js";
import { TABLE_MM, withPicture } from "./picture.js";
import { together } from "./together.js";
import { Scene3D } from "./view/scene3d.js";

const BENCH = "bench", OWN_PICTURE = "own picture", TABLE = "table";

export class Stage {
  // `robots`: robots.json. `onPull`: called with a message when somebody pulls. `onPicture`: when somebody wants an own picture.
  constructor(elements, { robots, onPull, onChoice, onPicture }) {
    Object.assign(this, elements);
    this.robots = robots;
    this.onPull = onPull;
    this.scene = null;
    this.shown = null;
    this.shownWorld = "";
    this.picture = null;
    this.robot.append(...robots.map(({ name, title }) => new Option(title, name)), new Option("No robot: the bench", BENCH));
    this.robot.onchange = () => onChoice(this.robot.value, "");
    this.world.onchange = () => {
      if (this.world.value !== OWN_PICTURE) return onChoice(this.robot.value, this.world.value);
      this.world.value = this.shownWorld;
      onPicture();
    };
    this.follow.onchange = () => this.scene && (this.scene.follows = this.follow.checked);
    this.home.onclick = () => this.scene?.home();
  }

  // File of what is on the stage, files of a robot for each hub and of their world, or null for the bench.
  get file() {
    return this.shown;
  }

  // Numbers of a frame of its bodies.
  get width() {
    return this.shown && this.drawing ? 7 * this.drawing.bodies.length : 0;
  }

  // Show a robot in a world; what is not there becomes the first there is. `picture`: an own one on the floor, as of readPicture; with
  // the size of the table it lies on that.
  async choose(robotName, worldName, picture = null) {
    const robot = this.robots.find(({ name }) => name === robotName);
    this.robot.value = robot ? robot.name : BENCH;
    const worlds = robot?.worlds ?? [], world = worlds.find(({ name }) => name === worldName) ?? worlds[0];
    this.offerWorlds(worlds, world, picture, robot?.drives);
    this.view.hidden = !robot;
    this.shown = world?.file ?? null;
    this.lesson = world?.lesson ?? null;
    this.picture = picture;
    if (robot) await this.fetch(() => fetchRobot(world.file, robot.meshes), picture);
  }

  // Show robots that share a world, as of Room.world, or benches if there is none. `robotName`: the one that is chosen.
  async chooseTogether(entry, robotName, picture = null) {
    this.robot.value = entry ? robotName : BENCH;
    this.offerWorlds(entry?.worlds ?? [], entry?.world, picture, Boolean(entry));
    this.view.hidden = !entry;
    this.lesson = null;
    const files = entry && { robots: entry.robots.map(({ file }) => file), world: entry.world.file };
    if (JSON.stringify(this.shown) === JSON.stringify(files) && this.picture === picture) return;
    this.shown = files;
    this.picture = picture;
    if (entry) await this.fetch(() => fetchTogether(entry), picture);
  }

  offerWorlds(worlds, world, picture, hasOwnPicture) {
    this.world.replaceChildren(...worlds.map(({ name, title }) => new Option(title, name)));
    if (hasOwnPicture) this.world.append(new Option(picture ? "another picture …" : "your own picture …", OWN_PICTURE));
    this.world.value = this.shownWorld = world?.name ?? "";
    this.world.parentElement.hidden = this.world.options.length < 2;
  }

  async fetch(read, picture) {
    const shown = this.shown, plain = await read();
    if (shown !== this.shown || picture !== this.picture) return; // another one was chosen meanwhile
    const { drawing, start } = picture ? withPicture(plain, picture) : plain;
    this.load(drawing, new Float32Array(start));
  }

  // The world on which a picture of this size lies.
  worldFor([width_mm, height_mm]) {
    const isTable = width_mm === TABLE_MM[0] && height_mm === TABLE_MM[1];
    return isTable ? TABLE : "";
  }

  load(drawing, start) {
    this.drawing = drawing;
    try {
      this.scene ??= this.makeScene();
    } catch (error) {
      this.view.textContent = `The robot cannot be drawn: ${error.message}. Its program runs all the same.`;
      return;
    }
    this.scene.load(drawing);
    this.scene.setPoses(start);
  }

  makeScene() {
    const scene = new Scene3D(this.canvas, this.metres);
    scene.follows = this.follow.checked;
    scene.onPull = (body, point, from, to) => {
      if (body < 0) {
        this.pull.hidden = true;
        this.onPull({ kind: "let go" });
        return;
      }
      const way = [to[0] - from[0], to[1] - from[1]];
      this.pull.hidden = false;
      Object.assign(this.pull.style, { left: `${from[0]}px`, top: `${from[1]}px`, width: `${Math.hypot(...way)}px`, transform: `rotate(${Math.atan2(way[1], way[0])}rad)` });
      this.onPull({ kind: "pull", body: this.drawing.bodies[body].model_body, at: point });
    };
    return scene;
  }

  // A frame of the run, whose first numbers are of the hub.
  frame(poses) {
    if (poses.length) this.scene?.setPoses(poses);
  }
}

const read = async (name) => (await fetchPacked(name)).json();

// A file whose drawing names meshes of another one by their numbers.
function resolved(plain, meshes) {
  plain.drawing.meshes = plain.drawing.meshes.map((mesh) => (typeof mesh === "number" ? meshes[mesh] : mesh));
  return plain;
}

// A robot's file. Its meshes are in one file for all of its worlds.
async function fetchRobot(file, meshFile) {
  return resolved(...(await Promise.all([read(file), read(meshFile)])));
}

// A world's file. What is drawn there is in the file of a robot that is alone in it, too.
async function fetchWorld({ file, drawn_in }) {
  const [plain, alone] = await Promise.all([read(file), drawn_in && read(drawn_in)]);
  return resolved(plain, alone?.drawing.meshes);
}

// The same of robots that share a world; two of a kind share a file.
async function fetchTogether(entry) {
  const files = new Map();
  for (const { file, meshes } of entry.robots) if (!files.has(file)) files.set(file, fetchRobot(file, meshes));
  const [world, ...robots] = await Promise.all([fetchWorld(entry.world), ...entry.robots.map(({ file }) => files.get(file))]);
  return { robot: { scene: world.scene }, ...together({ robots, world }) };
}
