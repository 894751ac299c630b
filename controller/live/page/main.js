// Joins the parts: rows from the link go into the store; at each frame of the screen the scope shows them.

import { Link } from "./link.js";
import { Store } from "./store.js";
import { TimeWindow, SPANS } from "./window.js";
import { Scope, degrees, format } from "./scope.js";
import { Events } from "./events.js";
import { GuardMap } from "./map.js";
import { Knobs } from "./knobs.js";
import { Hand } from "./hand.js";
import { DeadMan } from "./dead_man.js";
import { Strip } from "./strip.js";
import { keepLaws } from "./backdrop.js";

const element = (id) => document.getElementById(id);
const state = { laws: [], marks: [], pin: null, cursor: null, hello: null, ended: "", health: "" };
let store = new Store(1, []), view = new TimeWindow(store), scope = null, dirty = true;
const events = new Events(element("marks"), (time) => change(() => view.show(time - 1, time + 1)));
state.marks = events.marks;
const map = new GuardMap(element("plane"), element("limits"), element("reasons"));
const hand = new Hand(element("hand"), element("stiff"), state, (what) => link.send(what));
const deadMan = new DeadMan(element("hold"), () => hand.pointer !== null, (what) => link.send(what));
element("stiff").addEventListener("input", () => { element("grips").value = element("stiff").value; });
const strip = new Strip(element("strip"), (axis) => link.send({ axis }));
const knobs = new Knobs(element("rows"), (what) => link.send(what));

function change(action) {
  action();
  dirty = true;
}

function greet(hello) {
  state.hello = hello;
  store = new Store(hello.capacity, hello.channels, hello.rate_hz);
  const before = view;
  view = new TimeWindow(store);
  view.span = before.span;
  events.clear();
  state.laws.length = 0;
  map.show(null);
  strip.greet(hello);
  hand.release(); // it held another axis
  knobs.turn = null; // the range of another axis
  element("grip").hidden = !(hello.hand && hello.controls);
  element("held").hidden = !(hello.dead_man && hello.controls);
  element("may").textContent = hello.controls ? "" : hello.recorded ? "(recorded)" : "(to change it: --live-control)";
  document.title = element("name").textContent = hello.recorded ? `${hello.name} (recorded)` : hello.name;
  if (scope) scope.store = store;
  else scope = new Scope(element("panels"), store, state, {
    zoom: (from, to) => change(() => view.show(from, to)),
    wheel: (factor, time) => change(() => view.zoom(factor, time)),
    shift: (seconds) => change(() => view.shift(seconds)),
    follow: () => change(() => view.follow()),
    pin: (time) => change(() => { state.pin = state.pin === null ? time : null; }),
    cursor: (time) => change(() => { state.cursor = time; }),
  });
}

const heard = {
  hello: greet,
  marks: ({ marks }) => events.add(marks),
  laws: ({ laws }) => keepLaws(state.laws, laws),
  health: ({ volts, celsius }) => { state.health = `${state.hello.axes.length > 1 ? "hottest servo " : ""}${volts} V · ${celsius} °C`; },
  wall: (wall) => {
    const first = !knobs.told;
    knobs.show(wall, state.hello);
    if (first && parent !== window) parent.postMessage("ready", "*");
  },
  map: (limits) => map.show(limits),
  strip: ({ axes }) => strip.show(axes, state.ended),
  answer: (told) => {
    knobs.answer(told);
    if (!told.waits) lower();
  },
  beat: ({ beat }) => deadMan.beat(beat),
  ended: ({ words }) => { state.ended = words; link.over = true; },
  refused: ({ words }) => console.warn(words),
};

const link = new Link({
  open: () => say("connected", false),
  rows: (buffer) => change(() => {
    const whole = state.hello.recorded && view.follows;
    store.take(buffer);
    if (whole) view.span = Math.max(1, store.last - store.first);
  }),
  text: (message) => change(() => heard[message.kind]?.(message)),
  lost: (reason) => say(state.ended || reason || "no connection to the run; trying again", !state.ended),
});

// The page of the demo, around this one, asks for a wall: the shaft is lifted off meanwhile.
const LIFT_RAD = 0.08, GRIP = 20, EVERY_MS = 50, LEAST_MS = 600, LONGEST_MS = 15000; // grip in N·m/rad
let lift = null;
addEventListener("message", ({ data, origin, source }) => {
  if (parent === window || source !== parent || new URL(origin).hostname !== location.hostname || !knobs.told) return;
  clearInterval(lift?.timer);
  const hold = () => {
    if (Date.now() > lift.since + LONGEST_MS) lower();
    else link.send({ hand: { position: knobs.told.wall.position - LIFT_RAD, stiffness: GRIP } });
  };
  lift = { since: Date.now(), timer: setInterval(hold, EVERY_MS) };
  knobs.ask(data.set);
});

function lower() {
  const { timer, since } = lift ?? {};
  if (!timer) return;
  setTimeout(() => {
    if (timer !== lift?.timer) return; // another wish came
    const off = store.length && store.value("flags", store.length - 1) & state.hello.off;
    if (off && Date.now() < since + LONGEST_MS) return lower(); // it comes on when the shaft is lifted off
    clearInterval(timer);
    link.send({ hand: null });
    lift = null;
  }, Math.max(100, since + LEAST_MS - Date.now()));
}

function say(words, bad) {
  element("state").textContent = words;
  element("state").classList.toggle("bad", bad);
}

function report() {
  const newest = store.length - 1;
  const gone = state.ended && !state.hello.recorded;
  element("off").classList.toggle("shown", newest >= 0 && Boolean(gone || store.value("flags", newest) & state.hello.off));
  if (newest < 0) return;
  const row = state.cursor === null ? newest : Math.min(newest, store.at(state.cursor));
  scope.label(row);
  const of = (name) => store.value(name, newest);
  if (!element("grip").hidden) hand.draw(of("position_rad"));
  map.move(of("stiffness"), of("damping"), of("delay_s"), Boolean(of("flags") & state.hello.softer));
  if (link.socket.readyState === WebSocket.OPEN) {
    const parts = [
      state.ended,
      `${store.last.toFixed(2)} s`,
      `K ${format(of("stiffness"))} N·m/rad`,
      `B ${format(of("damping"))} N·m·s/rad`,
      `delay ${format(1e3 * of("delay_s"), 3)} ms`,
      state.health,
      store.gaps ? `${store.gaps} rows skipped` : "",
    ];
    say(parts.filter(Boolean).join(" · "), false);
  }
  element("readout").textContent = readout(row);
}

function readout(row) {
  if (state.pin === null) return state.cursor === null ? "drag: zoom · wheel: zoom · click: pin a cursor · double click: newest" : `t ${store.time[row].toFixed(4)} s`;
  const pinned = Math.min(store.length - 1, store.at(state.pin));
  const dt = store.time[row] - store.time[pinned];
  const difference = (name) => format(store.value(name, row) - store.value(name, pinned));
  const rate = dt ? ` (${format(1 / Math.abs(dt), 3)} Hz)` : "";
  return `from the pin: Δt ${(1e3 * dt).toFixed(1)} ms${rate}, Δx ${difference("position_rad")} rad (${degrees(store.value("position_rad", row) - store.value("position_rad", pinned))}), Δτ ${difference("torque_nm")} N·m`;
}

function frame() {
  requestAnimationFrame(frame);
  if (!dirty || !scope) return;
  dirty = false;
  element("pause").setAttribute("aria-pressed", String(!view.follows));
  element("pause").textContent = view.follows ? "Pause" : "Continue";
  for (const button of element("spans").children) button.setAttribute("aria-pressed", String(view.follows && +button.value === view.span));
  scope.draw(view.stretch);
  report();
}

for (const span of SPANS) {
  const button = element("spans").appendChild(document.createElement("button"));
  Object.assign(button, { type: "button", value: span, textContent: `${span} s` });
  button.addEventListener("click", () => change(() => view.follow(span)));
  element("spans").append(" ");
}
element("pause").addEventListener("click", () => change(() => (view.follows ? view.hold() : view.follow())));
addEventListener("keydown", (event) => {
  if (event.key === " " && event.target === document.body) {
    event.preventDefault();
    element("pause").click();
  }
});
requestAnimationFrame(frame);
