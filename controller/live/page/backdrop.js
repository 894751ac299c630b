// Draws behind and over the curves: the law at its positions, the events, the pinned cursor.

const MOST_LAWS = 200;

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

// The spring's torque at a position, between the points that the server computed.
export function torqueAt(law, position) {
  const place = ((position - law.low) / (law.high - law.low)) * (law.torque.length - 1);
  const index = Math.max(0, Math.min(law.torque.length - 2, Math.floor(place)));
  const part = Math.max(0, Math.min(1, place - index));
  return law.torque[index] * (1 - part) + law.torque[index + 1] * part;
}

// Add laws, or draw the newest one anew: `since` is the time from which a law was in force.
export function keepLaws(laws, more) {
  for (const law of more) {
    if (laws.at(-1)?.since === law.since) laws.pop();
    laws.push(law);
  }
  laws.splice(0, laws.length - MOST_LAWS);
}

// Shade each position by the torque there, of the law of each time: one hue where it pushes down, the other where up.
export function drawLaws(plot, laws) {
  const { ctx, bbox } = plot, step = 2 * devicePixelRatio, right = bbox.left + bbox.width;
  const place = (time) => Math.max(bbox.left, Math.min(right, plot.valToPos(time, "x", true)));
  const seen = laws.map((law, k) => ({ law, left: place(law.since), right: k + 1 < laws.length ? place(laws[k + 1].since) : right })).filter((each) => each.right > each.left);
  let most = 1e-9;
  for (const each of seen) {
    each.rows = [];
    for (let y = bbox.top; y < bbox.top + bbox.height; y += step) each.rows.push([y, torqueAt(each.law, plot.posToVal((y + step / 2 - bbox.top) / devicePixelRatio, "y"))]);
    most = Math.max(most, ...each.rows.map(([, torque]) => Math.abs(torque)));
  }
  const push = colour("--push"), pull = colour("--pull");
  ctx.save();
  for (const { law, left, right: end, rows } of seen) {
    for (const [y, torque] of rows) {
      const share = Math.abs(torque) / most;
      if (share < 1e-3) continue;
      ctx.fillStyle = `rgba(${torque < 0 ? push : pull}, ${0.08 + 0.3 * share})`;
      ctx.fillRect(left, y, end - left, Math.min(step, bbox.top + bbox.height - y));
    }
    const surface = plot.valToPos(law.surface, "y", true);
    if (law.name !== "wall" || surface <= bbox.top || surface >= bbox.top + bbox.height) continue;
    ctx.fillStyle = colour("--wall");
    ctx.fillRect(left, surface - devicePixelRatio / 2, end - left, 1.5 * devicePixelRatio);
  }
  ctx.restore();
}

const strong = new Set(["alarm", "end", "reduction", "change"]);

// A line for each event; its words where there is room, if `words`.
export function drawMarks(plot, marks, words) {
  const { ctx, bbox } = plot, ratio = devicePixelRatio;
  ctx.save();
  ctx.font = `${11 * ratio}px system-ui, "DejaVu Sans", sans-serif`;
  ctx.textBaseline = "bottom";
  ctx.textAlign = "left";
  let free = -Infinity;
  for (const mark of marks) {
    const x = Math.round(plot.valToPos(mark.t, "x", true));
    if (x < bbox.left || x > bbox.left + bbox.width) continue;
    ctx.fillStyle = colour(markColour(mark.kind));
    ctx.globalAlpha = strong.has(mark.kind) ? 0.85 : 0.35;
    ctx.fillRect(x, bbox.top, Math.max(1, ratio), bbox.height);
    if (!words) continue;
    const text = mark.words.length > 34 ? `${mark.words.slice(0, 33)}…` : mark.words;
    const width = ctx.measureText(text).width;
    const left = Math.min(x + 4 * ratio, bbox.left + bbox.width - width);
    if (left < free) continue;
    ctx.globalAlpha = 1;
    ctx.fillText(text, left, bbox.top + bbox.height - 3 * ratio);
    free = left + width + 12 * ratio;
  }
  ctx.restore();
}

export function drawPin(plot, time) {
  if (time === null) return;
  const { ctx, bbox } = plot, x = Math.round(plot.valToPos(time, "x", true));
  if (x < bbox.left || x > bbox.left + bbox.width) return;
  ctx.save();
  ctx.strokeStyle = colour("--accent");
  ctx.setLineDash([4 * devicePixelRatio, 3 * devicePixelRatio]);
  ctx.lineWidth = devicePixelRatio;
  ctx.beginPath();
  ctx.moveTo(x, bbox.top);
  ctx.lineTo(x, bbox.top + bbox.height);
  ctx.stroke();
  ctx.restore();
}

export const markColour = (kind) => ({
  alarm: "--alarm", end: "--alarm", reduction: "--reduction", loss: "--loss", change: "--change",
}[kind] ?? "--note");

export { colour };
