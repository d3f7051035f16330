// What is drawn of robots that share a world, put together of their files by page and worker alike; their model is put together by
// Python (tab/robot_file.py), whose order of bodies is this one: the world, the robots, what can be pushed.

export const COLOURS = [[0.1, 0.6, 0.6], [0.9, 0.5, 0.1], [0.55, 0.35, 0.75], [0.85, 0.25, 0.35]]; // of the discs on the robots' hubs

// `parts`: { robots, world }, files of each hub's robot and of the world. Returns `drawing` and `start` as of a robot's file.
export function together({ robots, world }) {
  const meshes = new Map(), numberOf = (mesh) => meshes.get(mesh) ?? meshes.set(mesh, meshes.size).get(mesh);
  const shaped = ({ drawing }, body) => ({ ...body, shapes: body.shapes.map((shape) => ({ ...shape, mesh: numberOf(drawing.meshes[shape.mesh]) })) });
  const bodies = [], start = [], spinners = [], rods = [];
  // Numbers of the parts that come before those of a robot; bodies without the world's own.
  const before = { bodies: 0, positions: 0, sites: 0 };
  robots.forEach((part, number) => {
    const { drawing, disc, counts } = part, name = `robot${number + 1}/`, place = world.starts[number];
    const move = (body) => (body === 0 ? 0 : body + before.bodies);
    drawing.bodies.forEach((body, index) => {
      const made = shaped(part, { ...body, name: body.name.replace(/^robot1\//, name), model_body: move(body.model_body) });
      if (index === disc.body) made.shapes[disc.shape].colour = [...COLOURS[number], 1];
      bodies.push(made);
    });
    for (let i = 0; i < part.start.length; i += 7) start.push(...moved(part.start.slice(i, i + 7), place));
    for (const one of drawing.spinners) spinners.push({ ...one, body: move(one.body), parent: move(one.parent), address: one.address + before.positions });
    for (const one of drawing.rods) rods.push({ ...one, body: move(one.body), parent: move(one.parent), far_site: one.far_site + before.sites });
    for (const kind of Object.keys(before)) before[kind] += counts[kind];
  });
  for (const body of world.drawing.bodies) {
    const isWorld = body.model_body === 0;
    bodies.push(shaped(world, { ...body, model_body: isWorld ? 0 : body.model_body + before.bodies }));
  }
  start.push(...world.start);
  const { pictures, floor } = world.drawing, view = world.views[robots.length - 1];
  return { drawing: { meshes: [...meshes.keys()], pictures, bodies, floor, view, spinners, rods }, start };
}

// A pose at the origin, x, y, z and the quaternion, of a robot that starts at x, y (m) and a heading (deg, clockwise).
function moved([x, y, z, ...turn], [atX, atY, heading_deg]) {
  const angle = (-heading_deg * Math.PI) / 180, cosine = Math.cos(angle), sine = Math.sin(angle);
  const [c, s] = [Math.cos(angle / 2), Math.sin(angle / 2)], [w, i, j, k] = turn;
  return [atX + cosine * x - sine * y, atY + sine * x + cosine * y, z, c * w - s * k, c * i - s * j, c * j + s * i, c * k + s * w];
}
