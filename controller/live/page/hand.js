// The hand: drag the handle of the shaft. Only the pointer's position is sent; the spring is in the plant.

import { colour, torqueAt } from "./backdrop.js";

const EVERY_MS = 50, HEIGHT = 64, ROOM_RAD = 1; // what is seen on each side of the law

export class Hand {
  // send(object): to the server; state: {laws}
  constructor(canvas, stiffness, state, send) {
    Object.assign(this, { canvas, stiffness, state, send, shaft: NaN, pointer: null, timer: null });
    canvas.addEventListener("pointerdown", (event) => this.take(event));
    canvas.addEventListener("pointermove", (event) => { if (this.pointer !== null) this.pointer = this.position(event); });
    for (const kind of ["pointerup", "pointercancel", "lostpointercapture"]) canvas.addEventListener(kind, () => this.release());
    addEventListener("blur", () => this.release());
  }

  get range() {
    const edges = this.state.laws.at(-1)?.edges ?? [0];
    return [Math.min(...edges) - ROOM_RAD, Math.max(...edges) + ROOM_RAD];
  }

  position(event) {
    const box = this.canvas.getBoundingClientRect(), [low, high] = this.range;
    return low + ((event.clientX - box.left) / box.width) * (high - low);
  }

  take(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.pointer = this.position(event);
    this.tell();
    this.timer = setInterval(() => this.tell(), EVERY_MS);
  }

  tell() { this.send({ hand: { position: this.pointer, stiffness: +this.stiffness.value } }); }

  release() {
    if (this.pointer === null) return;
    clearInterval(this.timer);
    this.pointer = null;
    this.send({ hand: null });
  }

  draw(shaft) {
    const { canvas } = this, ratio = devicePixelRatio, [low, high] = this.range;
    const width = canvas.clientWidth * ratio, height = HEIGHT * ratio;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const ctx = canvas.getContext("2d"), middle = height / 2;
    const place = (position) => Math.max(0, Math.min(width, ((position - low) / (high - low)) * width));
    ctx.clearRect(0, 0, width, height);
    this.shade(ctx, width, height, low, high);
    ctx.strokeStyle = colour("--line");
    ctx.lineWidth = ratio;
    ctx.strokeRect(ratio / 2, ratio / 2, width - ratio, height - ratio);
    if (this.pointer !== null) {
      ctx.strokeStyle = colour("--accent");
      ctx.lineWidth = 2 * ratio;
      ctx.beginPath();
      const from = place(shaft), to = place(this.pointer), turns = 14;
      for (let k = 0; k <= turns; k++) ctx.lineTo(from + ((to - from) * k) / turns, middle + (k % 2 ? 6 : -6) * ratio * (k > 0 && k < turns));
      ctx.stroke();
    }
    ctx.fillStyle = colour("--position");
    ctx.beginPath();
    ctx.arc(place(shaft), middle, 13 * ratio, 0, 7);
    ctx.fill();
  }

  shade(ctx, width, height, low, high) {
    const law = this.state.laws.at(-1);
    if (!law) return;
    const step = 2 * devicePixelRatio, torques = [];
    for (let x = 0; x < width; x += step) torques.push(torqueAt(law, low + ((x + step / 2) / width) * (high - low)));
    const most = Math.max(1e-9, ...torques.map(Math.abs));
    torques.forEach((torque, k) => {
      const share = Math.abs(torque) / most;
      if (share < 1e-3) return;
      ctx.fillStyle = `rgba(${colour(torque < 0 ? "--push" : "--pull")}, ${0.08 + 0.3 * share})`;
      ctx.fillRect(k * step, 0, step, height);
    });
  }
}
