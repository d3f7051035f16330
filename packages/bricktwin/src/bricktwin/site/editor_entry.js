// Editor of hub programs: CodeMirror with Python's highlighting, and completion of the names that a hub knows.

import { autocompletion, snippetCompletion } from "@codemirror/autocomplete";
import { indentWithTab } from "@codemirror/commands";
import { globalCompletion, localCompletionSource, python } from "@codemirror/lang-python";
import { indentUnit } from "@codemirror/language";
import { lintGutter, setDiagnostics } from "@codemirror/lint";
import { EditorState } from "@codemirror/state";
import { EditorView, keymap } from "@codemirror/view";
import { basicSetup } from "codemirror";

export class Editor {
  // `names`: pybricks.json, when it is there. `onChange`: called with the text after each change by the user.
  constructor(parent, { names, onChange, onRun }) {
    this.onChange = onChange;
    this.extensions = [
      keymap.of([{ key: "Mod-Enter", preventDefault: true, run: () => (onRun(), true) }, indentWithTab]),
      basicSetup,
      python(),
      indentUnit.of("    "),
      EditorState.tabSize.of(4),
      lintGutter(),
      autocompletion({ override: [(context) => completions(context, names), localCompletionSource, globalCompletion] }),
      EditorView.contentAttributes.of({ "aria-label": "Program", spellcheck: "false", autocapitalize: "off", autocorrect: "off" }),
      EditorView.updateListener.of((update) => update.docChanged && !this.isLoading && this.onChange(this.text)),
    ];
    this.view = new EditorView({ parent });
  }

  get text() {
    return this.view.state.doc.toString();
  }

  // Another program, with a history of its own.
  load(text) {
    this.isLoading = true;
    this.view.setState(EditorState.create({ doc: text, extensions: this.extensions }));
    this.isLoading = false;
  }

  // Errors at their lines: [{ line, message }]; none clears them.
  show(errors) {
    const { doc } = this.view.state;
    const diagnostics = errors.filter(({ line }) => line >= 1 && line <= doc.lines).map(({ line, message }) => {
      const { from, to, text } = doc.line(line), indent = text.length - text.trimStart().length;
      return { from: Math.min(from + indent, to), to, severity: "error", message };
    });
    this.view.dispatch(setDiagnostics(this.view.state, diagnostics));
    if (diagnostics.length) this.view.dispatch({ effects: EditorView.scrollIntoView(diagnostics[0].from, { y: "center" }) });
  }
}

function completions(context, names) {
  const line = context.state.doc.lineAt(context.pos), before = line.text.slice(0, context.pos - line.from);
  const offer = (labels, type, length) => ({
    from: context.pos - length, options: labels.map((label) => ({ label, type })), validFor: /^\w*$/,
  });
  const module = /^\s*from\s+([\w.]+)\s+import\s+(?:[\w\s,]*,\s*)?(\w*)$/.exec(before);
  if (module && names.modules[module[1]]) return offer(names.modules[module[1]], "class", module[2].length);
  const place = /^\s*(?:from|import)\s+([\w.]*)$/.exec(before);
  if (place) return { ...offer(Object.keys(names.modules), "namespace", place[1].length), validFor: /^[\w.]*$/ };
  const part = /(\w+)\.(\w+)\.(\w*)$/.exec(before);
  if (part && names.parts[part[2]]) return offer(names.parts[part[2]], "method", part[3].length);
  const member = /(\w+)\.(\w*)$/.exec(before);
  if (member) {
    const made = new RegExp(`\\b${member[1]}\\s*=\\s*(\\w+)\\s*\\(`).exec(context.state.doc.toString());
    const members = names.members[made ? made[1] : member[1]];
    return members ? offer(members, made ? "method" : "constant", member[2].length) : null;
  }
  const word = /\b(\w+)$/.exec(before);
  if (!word && !context.explicit) return null;
  const starts = [
    snippetCompletion("while True:\n    ${}\n    wait(10)", { label: "while", detail: "loop that waits", type: "keyword" }),
    snippetCompletion("from pybricks.${hubs} import ${PrimeHub}", { label: "from pybricks", detail: "import", type: "keyword" }),
  ];
  return { from: context.pos - (word ? word[1].length : 0), options: starts };
}
