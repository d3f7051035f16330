// What a program prints, as the terminal shows it.

const SHOWN = 100_000, KEPT = 5_000_000; // characters
// A browser keeps about a kilobyte for the layout of a line.
const LINES = 5000;
// It lays out a whole block for each new line of it, but no other block.
const BLOCK_LINES = 250, PIECE = 4000; // characters of a piece, which has one kind

export class Printed {
  constructor(element) {
    this.element = element;
    this.clear();
  }

  clear() {
    this.text = "";
    this.decoder = new TextDecoder();
    this.element.replaceChildren();
    this.block = null;
    this.blockLines = 0;
    this.last = null;
    this.waiting = []; // [text, kind], one after the other of another kind
    this.shown = 0; // characters
    this.lines = 0;
  }

  // Output of the program: bytes, a character each; a letter may be divided.
  out(bytes) {
    this.append(this.decoder.decode(Uint8Array.from(bytes, (byte) => byte.charCodeAt(0)), { stream: true }), "out");
  }

  // A program that prints without end has thousands of pieces a second: the page is laid out once for all of a moment.
  append(text, kind) {
    if (!text) return;
    if (!this.waiting.length) queueMicrotask(() => this.flush());
    const last = this.waiting.at(-1);
    if (last?.[1] === kind) last[0] += text;
    else this.waiting.push([text, kind]);
    this.text += text;
    if (this.text.length > 2 * KEPT) this.text = this.text.slice(-KEPT);
  }

  flush() {
    const pieces = this.waiting, element = this.element;
    this.waiting = [];
    const isAtEnd = element.scrollHeight - element.scrollTop - element.clientHeight < 40;
    for (const [text, kind] of pieces) this.show(text.slice(-SHOWN), kind);
    this.forget();
    if (isAtEnd) element.scrollTop = element.scrollHeight;
  }

  show(text, kind) {
    while (text) {
      if (!this.block || this.blockLines >= BLOCK_LINES) this.beginBlock();
      const part = firstLines(text, BLOCK_LINES - this.blockLines);
      this.showPiece(part, kind);
      text = text.slice(part.length);
    }
  }

  // Only where a line has ended: a block begins on a line of its own.
  beginBlock() {
    this.block = this.element.appendChild(document.createElement("span"));
    this.block.className = "block";
    this.blockLines = 0;
    this.last = null;
  }

  showPiece(text, kind) {
    if (this.last?.parentElement.className !== kind || this.last.length > PIECE) {
      const piece = document.createElement("span");
      piece.className = kind;
      this.last = piece.appendChild(document.createTextNode(""));
      this.block.append(piece);
    }
    this.last.appendData(text);
    const lines = linesIn(text);
    this.shown += text.length;
    this.lines += lines;
    this.blockLines += lines;
  }

  // The first pieces go, so that what is shown fills no memory.
  forget() {
    for (;;) {
      const block = this.element.firstElementChild, piece = block?.firstElementChild;
      if (!piece || piece === this.last?.parentElement) return;
      const text = piece.textContent, lines = linesIn(text);
      if (this.shown <= SHOWN && this.lines - lines < LINES) return;
      this.shown -= text.length;
      this.lines -= lines;
      piece.remove();
      if (!block.firstElementChild) block.remove();
    }
  }
}

function linesIn(text) {
  return text.split("\n").length - 1;
}

// At most so many lines of a text, or all that it has.
function firstLines(text, count) {
  let end = 0;
  for (let line = 0; line < count; line++) {
    const next = text.indexOf("\n", end);
    if (next < 0) return text;
    end = next + 1;
  }
  return text.slice(0, end);
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
