// The lesson of `haptic-wall demo`: five steps over the live pages of two runs, of which each is in a frame.

const wall = (stiffness, damping, steps = 0) => ({ "wall.stiffness": stiffness, "wall.damping": damping, "delay.steps": steps });
// The numbers are those of theory for the servos of the demo; a test computes them.
export const WALLS = {
  soft: wall(2.64, 0.02), stiff: wall(10.1, 0.02), prompt: wall(5.27, 0.02), late: wall(5.27, 0.02, 3),
  damped: wall(10.1, 0.175), too_much: wall(10.1, 0.349), far: wall(35.1, 0.02),
};
const STEPS = [
  ["A soft wall", ["soft"], `<p>Two equal servos render the same virtual wall, the shaded side. Inside it a spring pushes back with K = 2.64 N·m/rad, and a damper brakes with B = 0.02 N·m·s/rad. Each millisecond the computer reads the position and commands a torque. A weight presses each shaft into its wall.</p>
    <p>Drag the handle under “Your hand”: push it into the wall, pull it out, let go. With this damping a wall is stable on this servo up to K = 8.79 N·m/rad.</p>`],
  ["Too stiff: it buzzes", ["stiff", "soft"], `<p>K = 10.1 N·m/rad is 115 % of the limit. The servo without the guard oscillates, and nobody shakes it: the motor adds energy in each cycle, until the torque limit of 0.5 N·m bounds the motion at about 15 Hz.</p>
    <p>Hold the handle: your hand takes energy out. Let go: the oscillation begins again.</p>`],
  ["Why: half a period and the delay", ["prompt", "late"], `<p>The torque acts late: it is held for a period, on average half of one, 0.5 ms, and the delay from sample to torque is 2 ms. A spring that is 2.5 ms late gives out more energy than it took in. It acts as a negative damping of K × 2.5 ms. Friction and damper have b + B = 0.023 N·m·s/rad.</p>
    <p>So K must be below (b + B) / (T/2 + t<sub>d</sub>) = 9.2 N·m/rad. The exact limit is 8.79 N·m/rad. With three more periods of delay it is 3.86 N·m/rad, and the same wall of 5.27 N·m/rad oscillates.</p>`],
  ["More damping helps, too much does not", ["damped", "stiff", "too_much"], `<p>The damper takes energy. But its velocity comes from the same late samples: the highest limit, 38.4 N·m/rad, is at B = 0.175 N·m·s/rad. Above 0.324 N·m·s/rad the damper alone makes the servo oscillate.</p>
    <p>In the map of each servo, the dot moves along B.</p>`],
  ["The guard", ["stiff", "far", "late", "too_much"], `<p>Both servos get the same request. The guard knows bounds of inertia, friction and delay. It computes the limits, the curves of the map, and commands at most 0.8 of the lowest. Below the map it gives the reason.</p>
    <p>For your own servo: <code>haptic-wall init my-testbed.yaml --from xm430-w350</code>, then <code>haptic-wall doctor my-testbed.yaml</code>; <code>haptic-wall boundary</code> computes the limits of a servo that you describe.</p>`],
];
const WORDS = { soft: "The soft wall", stiff: "The stiff wall", prompt: "This wall", late: "The same wall, with more delay", damped: "More damping", too_much: "Too much damping", far: "Far too stiff" };

const element = (id) => document.getElementById(id);
const pages = { free: `/${location.search}`, guarded: decodeURIComponent(location.hash.slice(1)) };
const frames = Object.keys(pages).map(element);
for (const frame of frames) {
  const at = new URL(pages[frame.id], location.href);
  if (at.hostname === location.hostname) frame.src = at.href;
}
let step = 0;

function ask(name, of = frames) {
  for (const frame of of) frame.contentWindow.postMessage({ set: WALLS[name] }, new URL(frame.src).origin);
}

// The weight hangs in the wall at first: it comes on once the shaft is lifted off, as for any wish.
addEventListener("message", ({ data, source }) => {
  if (data === "ready") ask(STEPS[step][1][0], frames.filter((frame) => frame.contentWindow === source));
});

function show(which) {
  step = which;
  const [title, tries, text] = STEPS[step];
  element("title").textContent = `${step + 1}. ${title}`;
  element("text").innerHTML = text;
  element("back").disabled = step === 0;
  element("next").disabled = step === STEPS.length - 1;
  element("tries").replaceChildren(...tries.map((name) => {
    const button = document.createElement("button");
    Object.assign(button, { type: "button", value: name, textContent: WORDS[name] });
    button.addEventListener("click", () => ask(name));
    return button;
  }));
}

for (const [id, way] of [["back", -1], ["next", 1]]) {
  element(id).addEventListener("click", () => {
    show(step + way);
    ask(STEPS[step][1][0]);
  });
}
show(0);
