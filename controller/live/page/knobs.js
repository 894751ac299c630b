// The knobs: each sends its value as `haptic-wall set` would. One line below them says what became of the last wish.

import { degrees } from "./scope.js";

const KNOBS = [
  { path: "wall.stiffness", unit: "N·m/rad", max: 60, step: 0.5 },
  { path: "wall.damping", unit: "N·m·s/rad", min: -0.02, max: 0.5, step: 0.005 },
  { path: "wall.position", unit: "rad", step: 0.01 }, // over the travel
  { path: "delay.steps", unit: "periods", max: 20, step: 1 },
  // Of some laws only.
  { path: "wall.low", unit: "rad", min: -3, max: 3, step: 0.01 },
  { path: "wall.high", unit: "rad", min: -3, max: 3, step: 0.01 },
  { path: "wall.count", unit: "in a turn", min: 1, max: 100, step: 1 },
  { path: "wall.width", unit: "rad", min: 0.01, max: 2, step: 0.01 },
  { path: "wall.snap", unit: "of the width", min: 0.05, max: 0.45, step: 0.01 },
  { path: "wall.friction", unit: "N·m", min: 0.01, max: 2, step: 0.01 },
  { path: "wall.period", unit: "rad", min: 0.01, max: 1, step: 0.01 },
];
const EVERY_LAW = ["stiffness", "damping", "position"];
const EVERY_MS = 120; // least time between two requests while a knob turns

export class Knobs {
  // send(object): to the server
  constructor(root, send) {
    Object.assign(this, { root, send, count: 0, asked: null, wanted: null, timer: null, drag: null, told: null });
    this.rows = Object.fromEntries(KNOBS.map((knob) => [knob.path, this.row(knob)]));
    this.side = this.chooser("side", (side) => ({ "wall.side": side }));
    for (const name of ["above", "below", "both"]) this.side.add(new Option(name));
    this.law = this.chooser("law", (law) => ({ "wall.law": law, ...paths(this.laws[law].example) }));
    this.words = root.appendChild(document.createElement("p"));
    this.words.setAttribute("role", "status");
    this.say("");
  }

  line(path, content) {
    const line = this.root.appendChild(document.createElement("div")), name = path.replace(/^wall\.|\.steps$/, "");
    line.className = "knob";
    line.innerHTML = `<label for="${path}">${name}</label>${content.replaceAll("NAME", name)}`;
    return line;
  }

  row(knob) {
    const { path, step } = knob;
    const line = this.line(path, `<input type="range" id="${path}" step="${step}"><input type="number" aria-label="NAME" step="any"><span></span>`);
    const [slider, number] = line.querySelectorAll("input");
    const row = { ...knob, line, slider, number, words: line.querySelector("span") };
    const turn = (value) => { this.put(row, value); this.ask({ [path]: value }); };
    slider.addEventListener("input", () => turn(+slider.value)); // by the keyboard
    number.addEventListener("change", () => { if (number.value !== "") turn(+number.value); });
    // The pointer moves the value from where it is, so that a touch asks for nothing.
    line.addEventListener("pointerdown", ({ target, clientX, pointerId }) => {
      const { left, right, width } = slider.getBoundingClientRect();
      if (target !== line || slider.disabled || clientX < left || clientX > right) return;
      line.setPointerCapture(pointerId);
      this.drag = { row, from: clientX, value: row.value, each: (slider.max - slider.min) / width };
    });
    line.addEventListener("pointermove", ({ clientX }) => {
      if (this.drag?.row !== row) return;
      const { from, value, each } = this.drag;
      const next = Math.max(+slider.min, Math.min(+slider.max, value + step * Math.round(((clientX - from) * each) / step)));
      if (next !== row.value) turn(+next.toPrecision(9));
    });
    line.addEventListener("lostpointercapture", () => { this.drag = null; });
    return row;
  }

  chooser(path, changes) {
    const select = this.line(path, `<select id="${path}"></select>`).querySelector("select");
    select.addEventListener("change", () => this.ask(changes(select.value)));
    return select;
  }

  // Send the newest wish, not more often than the run can compute.
  ask(changes) {
    this.wanted = { ...(this.timer === null ? {} : this.wanted), ...changes };
    this.count++; // an answer to an older wish is none to this one
    this.say("asked");
    this.timer ??= setTimeout(() => {
      this.timer = null;
      this.send({ set: this.wanted, id: this.count });
    }, EVERY_MS);
  }

  say(words, kind = "") {
    this.words.textContent = words;
    this.words.className = `words answer ${kind}`;
  }

  // What became of the last wish.
  answer(told) {
    if (told.id !== this.count) return;
    if (told.waits) this.say(`waits: ${told.waits}`);
    else if (told.error) {
      this.say(told.error, "bad");
      this.show(this.told, this.hello); // what stays in force
    } else if (told.guard) this.say(clamp(told.guard), told.guard.reasons.length ? "bad" : "");
    else this.say("");
  }

  // Show a value; its slider reaches at least as far.
  put(row, value) {
    const { slider, number, min = 0, max } = row;
    const [low, high] = row.path === "wall.position" ? this.travel : [min, max];
    row.value = value;
    if (this.drag?.row !== row) Object.assign(slider, { min: Math.min(low, value), max: Math.max(high, value) });
    slider.value = value;
    if (document.activeElement !== number) number.value = value;
    row.words.textContent = row.unit === "rad" ? `rad ${degrees(value)}` : row.unit;
  }

  // Show the values in force; travel: of the position [rad], null: one turn about the first one.
  show(told, hello) {
    Object.assign(this, { told, hello, laws: hello.laws });
    const { wall, delay_steps: steps, travel } = told, may = hello.controls;
    this.travel = travel ?? (this.turn ??= [wall.position - Math.PI, wall.position + Math.PI]);
    const numbers = this.laws[wall.law]?.numbers ?? [];
    for (const [path, row] of Object.entries(this.rows)) {
      const name = path.slice("wall.".length), value = path === "delay.steps" ? steps : wall[name];
      row.line.hidden = value === null || !(path === "delay.steps" || EVERY_LAW.includes(name) || numbers.includes(name));
      row.slider.disabled = row.number.disabled = !may;
      if (this.drag?.row !== row && value !== null) this.put(row, value);
    }
    this.side.parentElement.hidden = !numbers.includes("side");
    this.side.value = wall.side;
    this.law.replaceChildren(...[...new Set([...Object.keys(this.laws), wall.law])].map((name) => new Option(name)));
    this.law.value = wall.law;
    this.side.disabled = this.law.disabled = !may;
  }
}

const paths = (numbers) => Object.fromEntries(Object.entries(numbers).map(([name, value]) => [`wall.${name}`, value]));

function clamp({ commanded, requested, reasons }) {
  const less = commanded.stiffness < requested.stiffness || commanded.damping < requested.damping;
  const values = `${+commanded.stiffness.toPrecision(4)} N·m/rad and ${+commanded.damping.toPrecision(4)} N·m·s/rad`;
  return less ? `commanded: ${values}: ${reasons[0] ?? ""}` : reasons.join("\n");
}
