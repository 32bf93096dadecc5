"use strict";
// Asks for state and pictures once a second, by paths relative to the page: BlueOS serves it below one of its own.
(() => {
  const levels = ["OK", "WARN", "ERROR", "STALE"], shown = ["done [Hz]", "work [s]", "latency [s]", "dropped", "last drop"];
  const cell = text => Object.assign(document.createElement("td"), {textContent: text});
  const row = node => {
    const made = document.createElement("tr"), values = shown.filter(key => key in node.values).map(key => `${key}: ${node.values[key]}`);
    const level = node.age_s > 5 ? "STALE" : levels[node.level] || "STALE";
    const first = cell(node.name), state = cell(level), said = cell([node.message, ...values].join("; "));
    if (level !== "OK") { state.className = "bad"; }
    made.append(first, state, said);
    return made;
  };
  const tell = (id, text) => { document.getElementById(id).textContent = text; };
  const state = async () => {
    try {
      const told = await (await fetch("state")).json();
      document.getElementById("nodes").replaceChildren(...told.nodes.map(row));
      tell("heard", told.nodes.length ? `on /diagnostics: ${told.nodes.length}` : "no node speaks on /diagnostics");
    } catch {
      tell("heard", "web_node does not answer");
    }
  };
  const picture = async image => {
    const name = image.id.slice("picture-".length), words = `words-${name}`;
    try {
      const answer = await fetch(`picture/${name}`);
      if (!answer.ok) { tell(words, (await answer.text()).trim().slice(0, 120)); return; }
      const before = image.src;
      image.src = URL.createObjectURL(await answer.blob());
      image.hidden = false;
      if (before) { URL.revokeObjectURL(before); }
      tell(words, "");
    } catch {
      tell(words, "web_node does not answer");
    }
  };
  const all = () => { if (!document.hidden) { state(); document.querySelectorAll("[id^=picture-]").forEach(picture); } };
  all();
  setInterval(all, 1000);
})();
