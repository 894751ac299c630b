// The strip: a row for each axis with its range, walls, position and torque; a click shows that axis.

const format = (value, unit) => (value === null ? "–" : `${value.toFixed(3)} ${unit}`);

export class Strip {
  // choose(name): show another axis
  constructor(root, choose) {
    Object.assign(this, { root, choose, rows: {}, most: 1e-3 }); // most: largest torque so far [N·m]
  }

  // Show the names of the axes, one of which is shown; a run of one axis has no strip.
  greet({ axes, axis }) {
    this.root.hidden = axes.length < 2;
    if (Object.keys(this.rows).join() !== axes.join()) {
      this.root.replaceChildren();
      this.rows = this.root.hidden ? {} : Object.fromEntries(axes.map((name) => [name, this.row(name)]));
    }
    for (const [name, { button }] of Object.entries(this.rows)) button.setAttribute("aria-pressed", String(name === axis));
  }

  row(name) {
    const button = this.root.appendChild(document.createElement("button"));
    button.type = "button";
    button.className = "axis";
    button.innerHTML = '<b></b><span class="range"><i></i><i></i><em></em></span><span class="place"></span><span class="torque"><em></em></span><span class="push"></span><span class="word"></span>';
    button.querySelector("b").textContent = name;
    button.addEventListener("click", () => this.choose(name));
    const [low, high, mark] = button.querySelectorAll(".range > *");
    const part = (selector) => button.querySelector(selector);
    return { button, low, high, mark, bar: part(".torque em"), place: part(".place"), push: part(".push"), word: part(".word") };
  }

  show(axes, ended) {
    this.most = Math.max(this.most, ...axes.map(({ torque }) => Math.abs(torque ?? 0)));
    for (const axis of axes) this.draw(this.rows[axis.name], axis, ended);
  }

  draw(row, { position, low, high, edges, walls, torque, off, alarm, stopped }, ended) {
    if (!row) return;
    const share = (value) => 100 * Math.max(0, Math.min(1, (value - low) / (high - low)));
    const known = position !== null && low !== null;
    row.mark.hidden = !known;
    row.low.hidden = !(known && walls[0]);
    row.high.hidden = !(known && walls[1]);
    if (known) {
      row.mark.style.left = `${share(position)}%`;
      row.low.style.width = `${share(edges[0])}%`;
      row.high.style.left = `${share(edges.at(-1))}%`;
    }
    const half = (50 * Math.abs(torque ?? 0)) / this.most;
    Object.assign(row.bar.style, { width: `${half}%`, left: `${torque < 0 ? 50 - half : 50}%` });
    row.place.textContent = format(position, "rad");
    row.push.textContent = format(torque, "N·m");
    row.word.textContent = stopped ? "ended the run" : ended ? "" : alarm ? "oscillates" : off ? "off" : "";
    row.button.classList.toggle("bad", alarm || stopped);
  }
}
