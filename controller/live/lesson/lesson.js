// The lesson: six steps over two running servos.

import { Servo } from "./servo.js";
import { Sound } from "./sound.js";
import { Knobs } from "./knobs.js";
import { STEPS, does, ownText } from "./steps.js";

const element = (id) => document.getElementById(id);
const sound = new Sound();
let step = 0;

const on = {
  lesson: () => tell(),
  again: (servo) => servo.link.send({ scene: STEPS[step].scene }), // its run was started anew
  rows: (servo, begin) => sound.feed(servo, begin, servo.told?.facts.servo?.torque_limit ?? 1),
  own: (told) => { element("limits-own").innerHTML = ownText(told); },
};
const free = new Servo("free", "Without the guard", element("servos"), on);
const guarded = new Servo("guarded", "With the guard", element("servos"), {
  ...on,
  wall: (wall) => knobs.show(wall, guarded.hello),
  answer: (told) => knobs.answer(told),
});
const servos = [free, guarded];
const send = (what) => servos.forEach((servo) => servo.link.send(what));
const knobs = new Knobs(element("rows"), send);
window.lesson = { free, guarded, sound }; // for tests, and for who is curious

function button(words, action, root) {
  const made = root.appendChild(document.createElement("button"));
  Object.assign(made, { type: "button", textContent: words });
  made.addEventListener("click", action);
  return made;
}

// Set text only where it is another one, so that it can be marked and read aloud.
function write(place, html) {
  if (place.shown === html) return;
  place.innerHTML = place.shown = html;
}

function show(which) {
  step = Math.max(0, Math.min(STEPS.length - 1, which));
  const { title, scene, tries } = STEPS[step];
  element("title").textContent = `${step + 1}. ${title}`;
  element("back").disabled = step === 0;
  element("next").disabled = step === STEPS.length - 1;
  [...element("dots").querySelectorAll("button")].forEach((dot, k) => (k === step ? dot.setAttribute("aria-current", "step") : dot.removeAttribute("aria-current")));
  element("tries").replaceChildren();
  for (const [name, words] of tries) button(words, () => send({ scene: name }), element("tries")).value = name;
  element("own").hidden = step !== STEPS.length - 1;
  if (element("own").hidden) button("Lift the weight and drop it", () => send({ drop: true }), element("tries"));
  if (!element("own").hidden) ask();
  send({ scene });
  tell();
}

function tell() {
  for (const servo of servos) {
    if (servo.told?.facts.asked) servo.say(servo.off ? "wall off" : does(servo.told), servo.told.measured_hz ? "bad" : "good");
  }
  if (!free.told?.facts.asked || !guarded.told?.facts.asked || !guarded.limits?.limits) return write(element("text"), "<p>The two servos are starting…</p>");
  for (const choice of element("tries").querySelectorAll("[value]")) choice.setAttribute("aria-pressed", String(choice.value === free.told.scene));
  const commanded = { stiffness: guarded.now("stiffness"), damping: guarded.now("damping") };
  write(element("text"), STEPS[step].text({ free: free.told, guarded: guarded.told, limits: guarded.limits, commanded }));
}

// Ask for the limits of the reader's servo.
function ask() {
  const value = (name) => (element("own").elements[name].value === "" ? null : +element("own").elements[name].value);
  free.link.send({ own: { inertia: value("inertia"), damping: value("damping"), period: 1 / value("rate"), delay: 1e-3 * value("delay"), virtual_damping: value("virtual_damping") } });
}

STEPS.forEach((_, k) => {
  const dot = button(String(k + 1), () => show(k), element("dots").appendChild(document.createElement("li")));
  dot.setAttribute("aria-label", `step ${k + 1}`);
});
element("back").addEventListener("click", () => show(step - 1));
element("next").addEventListener("click", () => show(step + 1));
element("own").addEventListener("input", ask);
element("own").addEventListener("submit", (event) => event.preventDefault());
for (const servo of servos) {
  servo.hear.addEventListener("click", () => {
    sound.toggle(servo);
    for (const each of servos) each.hear.setAttribute("aria-pressed", String(each === sound.servo));
  });
}
function frame() {
  requestAnimationFrame(frame);
  for (const servo of servos) servo.draw();
}
show(0);
requestAnimationFrame(frame);
