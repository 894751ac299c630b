// The knobs: each sends its value as `haptic-wall set` would, and says what became of it.

const KNOBS = [
  { path: "wall.stiffness", name: "stiffness", unit: "N·m/rad", max: 60, step: 0.5 },
  { path: "wall.damping", name: "damping", unit: "N·m·s/rad", min: -0.02, max: 0.5, step: 0.005 },
  { path: "wall.position", name: "position", unit: "rad", min: -1.5, max: 1.5, step: 0.01 },
  { path: "delay.steps", name: "delay", unit: "periods", max: 20, step: 1 },
];
// Another law begins with these numbers.
const LAWS = {
  wall: {}, spring: {}, damper: {}, stops: { "wall.low": -0.5, "wall.high": 0.5 }, detents: { "wall.count": 12 },
  texture: { "wall.period": 0.2 }, friction: { "wall.friction": 0.3 },
};
const EVERY_MS = 120; // least time between two requests while a knob turns

export class Knobs {
  // send(object): to the server
  constructor(root, send) {
    Object.assign(this, { root, send, count: 0, asked: null, wanted: null, timer: null });
    this.rows = Object.fromEntries(KNOBS.map((knob) => [knob.path, this.row(knob)]));
    this.law = this.chooser();
  }

  row({ path, name, unit, min = 0, max, step }) {
    const row = this.root.appendChild(document.createElement("div"));
    row.className = "knob";
    row.innerHTML = `<label for="${path}">${name}</label><input type="range" id="${path}" min="${min}" max="${max}" step="${step}">
      <input type="number" aria-label="${name}" step="any"><span>${unit}</span><p class="words" role="status"></p>`;
    const [slider, number] = row.querySelectorAll("input");
    slider.addEventListener("input", () => { number.value = slider.value; this.ask({ [path]: +slider.value }); });
    number.addEventListener("change", () => {
      if (number.value === "") return;
      slider.value = number.value;
      this.ask({ [path]: +number.value });
    });
    return { slider, number, words: row.querySelector(".words") };
  }

  chooser() {
    const row = this.root.appendChild(document.createElement("div"));
    row.className = "knob";
    row.innerHTML = '<label for="law">law</label><select id="law"></select><p class="words" role="status"></p>';
    const select = row.querySelector("select");
    for (const name of Object.keys(LAWS)) select.add(new Option(name));
    select.addEventListener("change", () => this.ask({ "wall.law": select.value, ...LAWS[select.value] }));
    return { select, words: row.querySelector(".words") };
  }

  // Send the newest wish, not more often than the run can compute.
  ask(changes) {
    this.wanted = changes;
    this.say(changes, "asked");
    this.timer ??= setTimeout(() => {
      this.timer = null;
      this.asked = this.wanted;
      this.send({ set: this.asked, id: ++this.count });
    }, EVERY_MS);
  }

  say(changes, words, kind = "") {
    const place = "wall.law" in changes ? this.law : this.rows[Object.keys(changes)[0]];
    place.words.textContent = words;
    place.words.className = `words ${kind}`;
  }

  // What became of the last wish.
  answer(told) {
    if (told.id !== this.count || !this.asked) return;
    if (told.waits) this.say(this.asked, `waits: ${told.waits}`);
    else if (told.error) this.say(this.asked, told.error, "bad");
    else if (told.guard) this.say(this.asked, clamp(told.guard), told.guard.reasons.length ? "bad" : "");
    else this.say(this.asked, "");
  }

  // Show the values in force.
  show({ wall, delay_steps: steps }, may) {
    const values = { "wall.stiffness": wall.stiffness, "wall.damping": wall.damping, "wall.position": wall.position, "delay.steps": steps };
    for (const [path, row] of Object.entries(this.rows)) {
      if (!row.slider.matches(":active")) row.slider.value = values[path];
      if (document.activeElement !== row.number) row.number.value = values[path];
      row.slider.disabled = row.number.disabled = !may;
    }
    const { select } = this.law;
    if (![...select.options].some((option) => option.value === wall.law)) select.add(new Option(wall.law));
    select.value = wall.law;
    select.disabled = !may;
  }
}

function clamp({ commanded, requested, reasons }) {
  const less = commanded.stiffness < requested.stiffness || commanded.damping < requested.damping;
  const values = `${+commanded.stiffness.toPrecision(4)} N·m/rad and ${+commanded.damping.toPrecision(4)} N·m·s/rad`;
  return less ? `commanded: ${values}: ${reasons[0] ?? ""}` : reasons.join("\n");
}
