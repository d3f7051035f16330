// What a program prints, as the terminal shows it.

const SHOWN = 100_000, KEPT = 5_000_000; // characters

export class Printed {
  constructor(element) {
    this.element = element;
    this.clear();
  }

  clear() {
    this.text = "";
    this.decoder = new TextDecoder();
    this.element.replaceChildren();
    this.last = null;
  }

  // Output of the program: bytes, a character each; a letter may be divided.
  out(bytes) {
    this.append(this.decoder.decode(Uint8Array.from(bytes, (byte) => byte.charCodeAt(0)), { stream: true }), "out");
  }

  append(text, kind) {
    if (!text) return;
    this.text = (this.text + text).slice(-KEPT);
    const isAtEnd = this.element.scrollHeight - this.element.scrollTop - this.element.clientHeight < 40;
    if (this.last?.className !== kind || this.last.textContent.length > 4000) {
      this.last = document.createElement("span");
      this.last.className = kind;
      this.element.append(this.last);
    }
    this.last.append(text);
    // A program that prints without end fills no memory: the first lines go.
    while (this.element.textContent.length > SHOWN && this.element.childElementCount > 1) this.element.firstElementChild.remove();
    if (isAtEnd) this.element.scrollTop = this.element.scrollHeight;
  }
}

// Errors at lines of a program, of a traceback as a hub prints it.
export function errorsOf(text, name) {
  const lines = text.trimEnd().split("\n"), begin = lines.lastIndexOf("Traceback (most recent call last):");
  if (begin < 0) return [];
  const traceback = lines.slice(begin + 1), places = traceback.filter((line) => /^\s+File "/.test(line));
  const message = traceback.find((line) => /^\w/.test(line)) ?? "error";
  const own = places.map((line) => /File "([^"]+)", line (\d+)/.exec(line)).filter((match) => match?.[1] === name);
  return own.length ? [{ line: Number(own.at(-1)[2]), message }] : [];
}
