// Programs of the user: kept in the browser, opened and saved as files, shared as links.

const KEY = "bricks-programs";

export class Programs {
  constructor() {
    this.files = {};
    this.current = "";
    this.robot = this.world = "";
    this.hubs = []; // program and robot of each hub of a room, if there are several
    this.hub = 0;
    try {
      Object.assign(this, JSON.parse(localStorage.getItem(KEY) ?? "{}"));
    } catch {
      // A browser may keep nothing, or what it kept is damaged: then there are none yet.
    }
    if (!Array.isArray(this.hubs) || this.hubs.length < 2 || !this.hubs[this.hub]) Object.assign(this, { hubs: [], hub: 0 });
    if (typeof this.files !== "object" || !(this.current in this.files)) this.current = Object.keys(this.files ?? {})[0] ?? "";
  }

  get source() {
    return this.files[this.current] ?? "";
  }

  keep() {
    const { files, current, robot, world, hubs, hub } = this;
    try {
      localStorage.setItem(KEY, JSON.stringify({ files, current, robot, world, hubs, hub }));
      return true;
    } catch {
      return false; // it is full, or keeps nothing
    }
  }

  write(source) {
    this.files[this.current] = source;
    return this.keep();
  }

  // Another program, which becomes the current one; the same one is not kept twice.
  add(name, source) {
    const [, stem] = /^(.*?)(\.py)?$/.exec(name.replace(/[^\w.-]+/g, "_") || "main");
    let free = `${stem}.py`;
    for (let i = 2; free in this.files && this.files[free] !== source; i++) free = `${stem}_${i}.py`;
    this.files[free] = source;
    this.current = free;
    this.keep();
  }

  rename(name) {
    const source = this.source, before = this.current;
    delete this.files[before];
    this.add(name, source);
    for (const one of this.hubs) if (one.program === before) one.program = this.current;
  }

  remove() {
    delete this.files[this.current];
    this.current = Object.keys(this.files)[0] ?? "";
    this.keep();
  }
}

export function saveFile(name, text) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: "text/plain" }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

// A link holds the program itself, in the part of an address that no server is told.
export async function linkOf(program) {
  const bytes = await through(new CompressionStream("deflate-raw"), new TextEncoder().encode(JSON.stringify(program)));
  const letters = Array.from(bytes, (byte) => String.fromCharCode(byte)).join("");
  const text = btoa(letters).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
  return `${location.href.split("#")[0]}#program=${text}`;
}

// An example that an address names, such as #example=walk.py.
export function exampleOf(fragment, examples) {
  const match = /^#example=([\w.-]+)$/.exec(fragment);
  return match ? examples.find(({ name }) => name === match[1]) ?? null : null;
}

export async function programOf(fragment) {
  const match = /^#program=([\w-]+)$/.exec(fragment);
  if (!match) return null;
  try {
    const packed = Uint8Array.from(atob(match[1].replaceAll("-", "+").replaceAll("_", "/")), (letter) => letter.charCodeAt(0));
    const program = JSON.parse(new TextDecoder().decode(await through(new DecompressionStream("deflate-raw"), packed)));
    return typeof program.source === "string" ? program : null;
  } catch {
    return null;
  }
}

async function through(stream, bytes) {
  return new Uint8Array(await new Response(new Blob([bytes]).stream().pipeThrough(stream)).arrayBuffer());
}
