// The plane of damping and stiffness: each limit a curve, what may be commanded, what is asked and commanded.

import { colour } from "./backdrop.js";

export const LIMITS = {
  linear: "--soft", exact: "--position", one_sided: "--torque", quantisation: "--age", passive: "--velocity",
  backlash: "--wall", flexible: "--alarm", resolution: "--resolution",
};
const NAMES = { one_sided: "one-sided" };

export class GuardMap {
  constructor(root, legend, words) {
    Object.assign(this, { root, legend, words, map: null, point: null, drawn: 0 });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.show(this.map));
    new ResizeObserver(() => {
      if (this.plot && this.root.clientWidth !== this.plot.width) this.plot.setSize({ width: this.root.clientWidth, height: 240 });
    }).observe(root);
  }

  show(map) {
    this.map = map;
    this.plot?.destroy();
    this.plot = null;
    this.root.replaceChildren();
    this.legend.replaceChildren();
    if (!map) return;
    if (map.trouble) { this.words.textContent = map.trouble; return; }
    const names = Object.keys(map.limits);
    const least = map.damping.map((_, k) => Math.min(...names.map((name) => map.limits[name][k] ?? Infinity)));
    const allowed = least.map((value) => (Number.isFinite(value) ? Math.max(0, map.margin * value) : null));
    const top = 1.3 * Math.max(map.commanded.stiffness, ...least.filter(Number.isFinite));
    const axis = { stroke: colour("--soft"), grid: { stroke: colour("--grid"), width: 1 }, ticks: { show: false }, font: '11px system-ui, "DejaVu Sans", sans-serif' };
    const line = (name) => ({ stroke: colour(LIMITS[name]), width: name === map.binding ? 2.5 : 1.3, points: { show: false } });
    this.plot = new uPlot({
      width: this.root.clientWidth,
      height: 240,
      padding: [8, 10, 0, 0],
      legend: { show: false },
      cursor: { show: false },
      scales: { x: { time: false }, y: { range: [0, top] } },
      axes: [
        { ...axis, size: 22, label: "damping B [N·m·s/rad]", labelSize: 16, labelFont: axis.font, labelGap: 0 },
        { ...axis, size: 44, label: "stiffness K [N·m/rad]", labelSize: 16, labelFont: axis.font, labelGap: 0 },
      ],
      series: [{}, { fill: `rgba(${colour("--pull")}, 0.15)`, width: 0, points: { show: false } }, ...names.map(line)],
      hooks: { draw: [(plot) => this.points(plot)] },
    }, [map.damping, allowed, ...names.map((name) => map.limits[name])], this.root);
    for (const name of names) {
      const item = this.legend.appendChild(document.createElement("li"));
      item.style.setProperty("--key", `var(${LIMITS[name]})`);
      item.textContent = (NAMES[name] ?? name) + (name === map.binding ? " (binds)" : "");
    }
    this.explain();
  }

  explain() {
    const { reasons, commanded } = this.map;
    const now = this.point?.[0] ?? commanded.stiffness;
    const less = now < 0.99 * commanded.stiffness ? `Now only ${+now.toPrecision(3)} N·m/rad, because ${this.cause()}. ` : "";
    this.words.textContent = less + (reasons.join("\n") || (less ? "" : "Commanded as requested."));
  }

  // Why less is commanded than at the delay of the map, with the period of the grid.
  cause() {
    const [, , delay, softer] = this.point, ms = (seconds) => (1e3 * seconds).toFixed(2);
    if (softer) return "the wall is softer against an oscillation: a probe, or since an alarm";
    if (delay > 1.04 * this.map.delay) return `samples are late: the delay is ${ms(delay)} ms, not ${ms(this.map.delay)} ms`;
    return "ticks are late or missed, or replies are lost: the guard counts a longer period";
  }

  // Move the commanded point: at most ten times a second. softer: by the oscillation watch.
  move(stiffness, damping, delay, softer) {
    const now = performance.now();
    if (!this.plot || now < this.drawn + 100) return;
    const point = [stiffness, damping, delay, softer];
    if (point.every((each, k) => each === this.point?.[k])) return;
    this.point = point;
    this.drawn = now;
    this.plot.redraw(false);
    this.explain();
  }

  points(plot) {
    const { requested, commanded } = this.map, { ctx, bbox } = plot, ratio = devicePixelRatio;
    const [stiffness, damping] = this.point ?? [commanded.stiffness, commanded.damping];
    const place = (k, b) => [
      Math.max(bbox.left, Math.min(bbox.left + bbox.width, plot.valToPos(b, "x", true))),
      Math.max(bbox.top + 7 * ratio, plot.valToPos(k, "y", true)),
    ];
    const asked = place(requested.stiffness, requested.damping), given = place(stiffness, damping);
    ctx.save();
    ctx.strokeStyle = ctx.fillStyle = colour("--ink");
    ctx.lineWidth = 1.5 * ratio;
    ctx.setLineDash([3 * ratio, 3 * ratio]);
    ctx.beginPath();
    ctx.moveTo(...asked);
    ctx.lineTo(...given);
    ctx.stroke();
    ctx.setLineDash([]);
    ctx.beginPath();
    ctx.arc(...asked, 5 * ratio, 0, 7);
    ctx.stroke();
    ctx.beginPath();
    ctx.arc(...given, 4 * ratio, 0, 7);
    ctx.fill();
    if (plot.valToPos(requested.stiffness, "y", true) < bbox.top) {
      ctx.font = `${11 * ratio}px system-ui, "DejaVu Sans", sans-serif`;
      ctx.textAlign = "left";
      ctx.fillText(`↑ ${requested.stiffness} requested`, asked[0] + 9 * ratio, asked[1] + 4 * ratio);
    }
    ctx.restore();
  }
}
