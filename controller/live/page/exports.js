// Saves what is seen: rows as CSV, panels as a picture.

import { colour } from "./backdrop.js";

function save(name, blob) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

export function csv(store, [from, to]) {
  const begin = store.at(from), end = store.at(to);
  const lines = [["time_s", ...store.channels].join(",")];
  for (let row = begin; row < end; row++) {
    const values = store.channels.map((name) => store.value(name, row));
    lines.push([store.time[row].toFixed(6), ...values.map((value) => (Number.isFinite(value) ? +value.toPrecision(8) : ""))].join(","));
  }
  return `${lines.join("\n")}\n`;
}

export function saveCsv(store, stretch, name) {
  save(`${name}.csv`, new Blob([csv(store, stretch)], { type: "text/csv" }));
}

// The panels below each other, with their labels.
export function picture(scope, title) {
  const canvases = scope.plots.map((plot) => plot.ctx.canvas), ratio = devicePixelRatio;
  const head = 28 * ratio;
  const whole = document.createElement("canvas");
  whole.width = canvases[0].width;
  whole.height = head + canvases.reduce((sum, canvas) => sum + canvas.height, 0);
  const ctx = whole.getContext("2d");
  ctx.fillStyle = colour("--card");
  ctx.fillRect(0, 0, whole.width, whole.height);
  ctx.fillStyle = colour("--ink");
  ctx.font = `${13 * ratio}px system-ui, "DejaVu Sans", sans-serif`;
  ctx.fillText(title, 10 * ratio, 18 * ratio);
  let top = head;
  canvases.forEach((canvas, index) => {
    ctx.drawImage(canvas, 0, top);
    ctx.fillStyle = colour("--soft");
    ctx.font = `${12 * ratio}px system-ui, "DejaVu Sans", sans-serif`;
    ctx.fillText(scope.labels[index].textContent, 66 * ratio, top + 15 * ratio);
    top += canvas.height;
  });
  return whole;
}

export function savePng(scope, name, title) {
  picture(scope, title).toBlob((blob) => save(`${name}.png`, blob), "image/png");
}
