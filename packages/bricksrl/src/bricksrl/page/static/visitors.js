// Visitors of a page: their names, notes to this one, and questions of one for what another one holds.

import { $, element, fill, press } from "./connection.js";

export const you = { name: "", note: "" };

// Take what the server says to this visitor alone.
export function hear(message) {
  Object.assign(you, message);
  document.cookie = `bricksrl_name=${encodeURIComponent(you.name)}; path=/; max-age=31536000; samesite=strict`;
}

export function showVisitors(status) {
  const others = (status.visitors ?? []).filter((name) => name !== you.name), box = $("visitors");
  const input = $("own-name");
  box.hidden = !you.name;
  if (document.activeElement !== input) input.value = you.name;
  const holds = Object.entries(status.holders ?? {});
  const told = (name) => {
    const held = holds.filter(([, by]) => by === name).map(([what]) => what);
    return held.length ? `${name} (${held.join(", ")})` : name;
  };
  $("others").textContent = others.length ? `also here: ${others.map(told).join(", ")}` : "";
  $("note").hidden = !you.note;
  $("note").textContent = you.note;
  showQuestions(status);
}

// Questions to this visitor, with two buttons, and the ones that this visitor waits for. They never cover the stop button.
function showQuestions({ holders = {}, questions = {} }) {
  const open = Object.entries(questions).filter(([what, by]) => by === you.name || holders[what] === you.name);
  fill($("questions"), open.map(([what, by]) => JSON.stringify([what, by])), "div", (row, key) => {
    const [what, by] = JSON.parse(key);
    row.className = "question";
    if (by === you.name) return row.append(`You have asked ${holders[what] ?? "for"} for the ${what}.`);
    row.setAttribute("role", "alertdialog");
    row.setAttribute("aria-label", `${by} asks`);
    const answer = (text, yes) => element("button", { type: "button", textContent: text, className: yes ? "main" : "", onclick: () => press("answer", [what, yes]) });
    row.append(element("p", { textContent: `${by} asks for your ${what}. Give it?` }), answer("Yes", true), answer("No", false));
  });
}

$("own-name").onchange = () => press("name", $("own-name").value);
$("own-name").onkeydown = (event) => {
  if (event.key === "Enter") $("own-name").blur(); // a handler that returns false would take every key from the field
};
