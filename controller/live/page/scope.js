// The scope: a panel for each quantity over one time axis. uPlot draws the least and the largest value
// of each pixel column, so that nothing between two frames is lost.

import { colour, drawLaws, drawMarks, drawPin } from "./backdrop.js";

export const PANELS = [
  { name: "position", unit: "rad", lines: [["position_rad", "--position"]], height: 3, least: 0.02, laws: true },
  { name: "torque", unit: "N·m", lines: [["wall_torque_nm", "--wall"], ["measured_torque_nm", "--measured"], ["torque_nm", "--torque"]], words: ["wall ", "measured ", "sent "], height: 2, least: 0.02, zero: true },
  { name: "velocity", unit: "rad/s", lines: [["velocity_rad_s", "--pale"], ["velocity_mean", "--velocity"]], shown: ["velocity_mean"], height: 1.6, least: 0.1, zero: true },
  { name: "lateness", unit: "µs", lines: [["lateness_us", "--lateness"]], height: 1.2, log: true },
  { name: "age of the sample", unit: "µs", lines: [["sample_age_us", "--age"]], height: 1.2, log: true },
];
const AXIS = 58;
const wholeRoom = () => Math.max(420, Math.min(900, innerHeight - 190));

export class Scope {
  // state: {laws, marks, pin}; on: {zoom(from, to), wheel(factor, time), pin(time), shift(s), follow(), cursor()}
  constructor(root, store, state, on, { panels = PANELS } = {}) {
    Object.assign(this, { root, store, state, on, panels, edges: [] });
    this.build();
    new ResizeObserver(() => this.resize()).observe(root);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.build());
  }

  build() {
    for (const plot of this.plots ?? []) plot.destroy();
    this.root.replaceChildren();
    this.width = this.root.clientWidth;
    this.plots = this.panels.map((panel, index) => this.panel(panel, index));
    this.labels = [...this.root.querySelectorAll(".label")];
  }

  heights() {
    const parts = this.panels.reduce((sum, panel) => sum + panel.height, 0);
    return this.panels.map((panel, index) => Math.round((panel.height * wholeRoom()) / parts) + (index === this.panels.length - 1 ? 26 : 0));
  }

  resize() {
    if (this.root.clientWidth === this.width) return;
    this.width = this.root.clientWidth;
    const heights = this.heights();
    this.plots.forEach((plot, index) => plot.setSize({ width: this.width, height: heights[index] }));
  }

  panel(panel, index) {
    const last = index === this.panels.length - 1;
    const box = this.root.appendChild(document.createElement("div"));
    box.className = "panel";
    box.innerHTML = '<div class="label"></div>';
    const line = { stroke: colour("--soft"), grid: { stroke: colour("--grid"), width: 1 }, ticks: { show: false }, font: '11px system-ui, "DejaVu Sans", sans-serif' };
    const options = {
      width: this.width,
      height: this.heights()[index],
      padding: [6, 8, last ? 0 : 4, 0],
      legend: { show: false },
      cursor: { sync: { key: "scope", setSeries: false }, drag: { x: true, y: false, setScale: false }, points: { size: 6 } },
      scales: { x: { time: false }, y: panel.log ? { distr: 3, range: decades } : { range: (_, low, high) => range(low, high, panel, this.edges) } },
      axes: [
        { ...line, show: true, size: last ? 26 : 0, values: (u, ticks) => (last ? ticks.map((t) => +t.toFixed(6)) : ticks.map(() => "")) },
        { ...line, size: AXIS, space: panel.log ? 14 : 26, ...(panel.log && { splits: wholeDecades, filter: (u, ticks) => ticks, values: (u, ticks) => ticks.map(decade) }) },
      ],
      series: [{}, ...panel.lines.map(([, stroke], k) => ({ stroke: colour(stroke), width: panel.name === "torque" && k === 0 ? 3 : 1.2, points: { show: false } }))],
      hooks: {
        drawClear: [(u) => { if (index === 0) drawLaws(u, this.state.laws); }],
        draw: [(u) => { drawMarks(u, this.state.marks, index === 0); drawPin(u, this.state.pin); }],
        setCursor: [(u) => { if (u.cursor.event) this.on.cursor(u.cursor.left >= 0 ? u.posToVal(u.cursor.left, "x") : null); }],
        setSelect: [(u) => this.select(u)],
        ready: [(u) => this.listen(u)],
      },
    };
    const empty = [[], ...panel.lines.map(() => [])];
    return new uPlot(options, empty, box);
  }

  select(plot) {
    const { left, width } = plot.select;
    if (width < 5) return;
    plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    this.on.zoom(plot.posToVal(left, "x"), plot.posToVal(left + width, "x"));
  }

  listen(plot) {
    const { over } = plot;
    const time = (event) => plot.posToVal(event.clientX - over.getBoundingClientRect().left, "x");
    over.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.on.wheel(Math.exp(0.002 * event.deltaY), time(event));
    }, { passive: false });
    over.addEventListener("dblclick", () => this.on.follow());
    let begin = null;
    over.addEventListener("pointerdown", (event) => { begin = { x: event.clientX, at: time(event), moved: false }; });
    over.addEventListener("pointermove", (event) => {
      if (!begin) return;
      if (Math.abs(event.clientX - begin.x) > 5) begin.moved = true;
      if (event.pointerType === "touch" && begin.moved) this.on.shift(begin.at - time(event));
    });
    over.addEventListener("pointerup", (event) => {
      if (begin && !begin.moved) this.on.pin(time(event));
      begin = null;
    });
    over.addEventListener("pointercancel", () => { begin = null; });
  }

  draw([from, to]) {
    this.root.dataset.to = to;
    const { laws } = this.state;
    this.edges = laws.filter((law, k) => law.since <= to && (laws[k + 1]?.since ?? Infinity) >= from).flatMap((law) => law.edges);
    const [begin, end] = this.store.indices(from, to), { time, columns } = this.store;
    const times = time.subarray(begin, end);
    const known = (values) => (values.some(Number.isFinite) ? values : Array(values.length).fill(null)); // else no scale fits
    this.plots.forEach((plot, index) => {
      const data = [times, ...this.panels[index].lines.map(([name]) => known(columns[name].subarray(begin, end)))];
      plot.batch(() => {
        plot.setData(data, false);
        plot.setScale("x", { min: from, max: to });
      });
    });
  }

  // Show the values of one row in the panels' labels.
  label(index) {
    this.panels.forEach((panel, k) => {
      const names = panel.shown ?? panel.lines.map(([name]) => name);
      const values = names.map((name) => this.store.value(name, index));
      const known = (_, i) => !panel.words || panel.words[i] !== "measured " || Number.isFinite(values[i]); // not every servo measures it
      const text = values.map((value, i) => `${panel.words?.[i] ?? ""}${format(value)}`).filter(known).join(", ");
      this.labels[k].innerHTML = `<span>${panel.name} <b>${text}</b> ${panel.unit}${panel.unit === "rad" ? ` (${degrees(values[0])})` : ""}</span>`;
    });
  }
}

export const degrees = (radians) => (Number.isFinite(radians) ? `${((180 / Math.PI) * radians).toFixed(1)}°` : "–");

export function format(value, digits = 4) {
  if (!Number.isFinite(value)) return "–";
  if (value !== 0 && Math.abs(value) < 5e-5) return "0.0000";
  return Math.abs(value) >= 1000 ? value.toFixed(0) : value.toPrecision(digits).slice(0, digits + 2 + (value < 0));
}

// Whole decades around positive values; what is zero lies below them.
function decades(_, low, high) {
  const whole = (value, round) => 10 ** round(Math.log10(Math.max(0.1, value || 0.1)));
  const floor = whole(low, Math.floor);
  return [floor, Math.max(100 * floor, whole(high, Math.ceil))];
}

function wholeDecades(_, axis, low, high) {
  const least = Math.round(Math.log10(low)), count = Math.round(Math.log10(high)) - least + 1;
  const step = count > 4 ? 2 : 1;
  return Array.from({ length: Math.ceil(count / step) }, (_, k) => 10 ** (least + step * k));
}

const decade = (value) => (value >= 1000 ? `${Math.round(value / 1000)}k` : String(+value.toPrecision(1)));

function range(low, high, panel, edges) {
  if (!Number.isFinite(low) || !Number.isFinite(high)) return [0, panel.least];
  if (panel.laws) { low = Math.min(low, ...edges); high = Math.max(high, ...edges); }
  if (panel.zero) { low = Math.min(low, 0); high = Math.max(high, 0); }
  const least = Math.max(0, panel.least - (high - low)) / 2;
  const room = 0.06 * (high - low);
  const floor = panel.zero && low >= 0;
  return [floor ? 0 : low - least - room, high + (floor ? 2 : 1) * least + room];
}
