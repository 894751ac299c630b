// The dead man: held while its button is down, or the handle is dragged. Each beat is answered while it is held; silence lets go.

export class DeadMan {
  // dragging(): whether the handle is held; send(object): to the server
  constructor(button, dragging, send) {
    Object.assign(this, { button, dragging, send, pressed: false, held: false, newest: 0 });
    button.addEventListener("pointerdown", (event) => { button.setPointerCapture(event.pointerId); this.press(true); });
    button.addEventListener("keydown", ({ key }) => { if (key === " " || key === "Enter") this.press(true); });
    for (const kind of ["pointerup", "pointercancel", "lostpointercapture", "keyup", "blur"]) button.addEventListener(kind, () => this.press(false));
    button.addEventListener("contextmenu", (event) => event.preventDefault());
    addEventListener("blur", () => this.press(false));
    document.addEventListener("visibilitychange", () => this.press(false));
  }

  press(pressed) {
    this.pressed = pressed;
    this.tell();
  }

  beat(beat) {
    this.newest = beat;
    this.tell();
  }

  tell() {
    const held = this.pressed || this.dragging();
    if (held || this.held) this.send({ hold: held ? this.newest : null });
    this.held = held;
    this.button.setAttribute("aria-pressed", String(held));
  }
}
