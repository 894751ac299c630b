// One servo of the lesson: its link, scope, map, handle and sound.

import { Link } from "./link.js";
import { Store } from "./store.js";
import { TimeWindow } from "./window.js";
import { PANELS, Scope } from "./scope.js";
import { GuardMap } from "./map.js";
import { Hand } from "./hand.js";
import { keepLaws } from "./backdrop.js";

const SPAN_S = 2, ROOM_RAD = 0.5, GRIP = 4, SCOPE_PX = 230; // grip in N·m/rad
// Scales that show rest as rest: at least this much, in rad and N·m.
const SHOWN = [{ ...PANELS[0], least: 0.2 }, { ...PANELS[1], least: 0.6 }];

export class Servo {
  // on: {lesson(told), wall(wall), answer(told), own(told), rows(servo, begin), again(servo)}
  constructor(name, title, root, on) {
    const card = document.getElementById("servo").content.cloneNode(true).firstElementChild;
    card.id = name;
    root.append(card);
    const part = (selector) => card.querySelector(selector);
    Object.assign(this, { name, on, card, part, told: null, limits: null, dirty: false, scope: null });
    part("h2").textContent = title;
    this.hear = part(".hear");
    this.state = { laws: [], marks: [], pin: null };
    this.map = new GuardMap(part(".plane"), part(".limits"), document.createElement("p"));
    this.hand = new Hand(part(".hand"), { value: GRIP }, this.state, (what) => this.link.send(what), ROOM_RAD);
    this.store = new Store(1, []);
    this.view = new TimeWindow(this.store);
    this.link = new Link({
      open: () => this.say("connected", ""),
      rows: (buffer) => {
        const begin = this.store.next;
        this.store.take(buffer);
        this.dirty = true;
        this.on.rows(this, Number.isFinite(begin) ? begin : this.store.next);
      },
      text: (message) => this.take(message),
      lost: (reason) => {
        this.told = null;
        if (this.link.over) this.say("ended", "");
        else this.say(reason || "no connection; trying again", "bad");
      },
    }, name);
  }

  take(message) {
    const { kind } = message;
    this.dirty = true;
    if (kind === "hello") this.greet(message);
    else if (kind === "laws") keepLaws(this.state.laws, message.laws);
    else if (kind === "over") this.link.over = true;
    else if (kind === "map") this.map.show(this.limits = message);
    else if (kind === "lesson") this.on.lesson(this.told = message);
    else if (kind === "refused") console.warn(message.words);
    else this.on[kind]?.(message);
  }

  greet(hello) {
    this.store = new Store(hello.capacity, hello.channels, hello.rate_hz);
    this.view = new TimeWindow(this.store);
    this.view.span = SPAN_S;
    this.hello = hello;
    this.state.laws.length = 0;
    const change = (action) => { action(this.view); this.dirty = true; };
    if (this.scope) {
      this.scope.store = this.store;
      this.on.again(this);
    } else this.scope = new Scope(this.part(".panels"), this.store, this.state, {
      zoom: (from, to) => change((view) => view.show(from, to)),
      wheel: (factor, time) => change((view) => view.zoom(factor, time)),
      shift: (seconds) => change((view) => view.shift(seconds)),
      follow: () => change((view) => view.follow(SPAN_S)),
      pin: () => change((view) => view.follow(SPAN_S)),
      cursor: () => {},
    }, { panels: SHOWN, room: () => SCOPE_PX, key: this.name });
  }

  say(words, kind) {
    const line = this.part(".state");
    if (line.textContent !== words) line.textContent = words;
    line.className = `state ${kind}`;
  }

  get off() { return Boolean(this.now("flags") & this.hello?.off); }

  now(name) { return this.store.length ? this.store.value(name, this.store.length - 1) : NaN; }

  // Draw what is new; called with each frame of the screen.
  draw() {
    if (!this.dirty || !this.scope) return;
    this.dirty = false;
    this.hand.draw(this.now("position_rad"));
    this.scope.draw(this.view.stretch);
    if (!this.store.length) return;
    this.scope.label(this.store.length - 1);
    this.map.move(this.now("stiffness"), this.now("damping"));
  }
}
