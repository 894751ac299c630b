// The six steps: title, the wall that each begins with, walls to try, and the text, whose numbers are all computed or measured.


const number = (value, digits = 3) => (Number.isFinite(value) ? String(+value.toPrecision(digits)) : "…");
const K = (value) => `<b>${number(value)} N·m/rad</b>`;
const B = (value) => `<b>${number(value)} N·m·s/rad</b>`;
const ms = (seconds) => `<b>${number(1e3 * seconds)} ms</b>`;
const Hz = (value) => `<b>${number(value)} Hz</b>`;

// What a servo does now.
export function does({ measured_hz: found, facts }) {
  if (found) return `oscillates at ${number(found)} Hz${facts.swings_hz ? `; theory says ${number(facts.swings_hz)} Hz` : ""}`;
  return "is calm";
}

const share = ({ asked, limit }) => (limit > 0 ? `you request K = ${K(asked.stiffness)}, <b>${Math.round((100 * asked.stiffness) / limit)} %</b> of it` : `you request K = ${K(asked.stiffness)}`);
const limitText = (facts) => (facts.limit > 0 ? `With this damping a wall is stable on this servo up to K = ${K(facts.limit)}; ${share(facts)}.` : `With so much damping no stiffness is stable; ${share(facts)}.`);
const seen = ({ free }) => `Measured now: the servo without the guard <b>${does(free)}</b>.`;

export const STEPS = [
  {
    title: "A soft wall",
    scene: "soft",
    tries: [],
    text: ({ free: { facts } }) => `
      <p>Two equal servos render the same virtual wall, the shaded side. Inside it a spring pushes back with K = ${K(facts.asked.stiffness)}, and a damper brakes with B = ${B(facts.asked.damping)}. Each ${ms(facts.period)} the computer reads the position and commands a torque. A weight presses each shaft into its wall.</p>
      <p class="ask">Drag a handle: push it into the wall, pull it out, let go.</p>
      <p>${limitText(facts)}</p>`,
  },
  {
    title: "Too stiff: it buzzes",
    scene: "stiff",
    tries: [["soft", "The soft wall"], ["stiff", "The stiff wall"]],
    text: ({ free, free: { facts } }) => `
      <p>${limitText(facts)} The weight was lifted and dropped on the wall.</p>
      <p>${seen({ free })} Nobody shakes it: the motor adds energy in each cycle, until the torque limit of <b>${number(facts.servo.torque_limit)} N·m</b> bounds the motion.</p>
      <p class="ask">Hold the handle: your hand takes energy out. Let go: the oscillation begins again. “Hear the torque” plays the torque as a sound. The other servo has a guard; step 5 explains it.</p>`,
  },
  {
    title: "Why: half a period and the delay",
    scene: "prompt",
    tries: [["prompt", "This wall"], ["late", "The same wall, with more delay"]],
    text: ({ free, free: { facts } }) => `
      <p>The torque acts late: it is held for a period, on average half of one, ${ms(0.5 * facts.period)}, and the delay from sample to torque is ${ms(facts.delay)}. A spring that is ${ms(facts.late)} late gives out more energy than it took in. It acts as a negative damping of K × ${ms(facts.late)} = ${B(facts.asked.stiffness * facts.late)}. Friction and damper have b + B = ${B(facts.servo.damping + facts.asked.damping)}.</p>
      <p>So K must be below (b + B) / (T/2 + t<sub>d</sub>) = ${K(facts.rule)}. The exact limit is ${K(facts.limit)}; there the servo oscillates at ${Hz(facts.frequency_hz)}. You request ${K(facts.asked.stiffness)}. ${seen({ free })}</p>`,
  },
  {
    title: "More damping helps, too much does not",
    scene: "damped",
    tries: [["stiff", "Little damping"], ["damped", "More"], ["too_much", "Too much"]],
    text: ({ free, free: { facts } }) => `
      <p>The damper takes energy: with B = ${B(facts.asked.damping)} ${facts.limit > 0 ? `the limit is K = ${K(facts.limit)}` : "no stiffness is stable"}; you request ${K(facts.asked.stiffness)}. But its velocity comes from the same late samples. The highest limit, ${K(facts.peak.stiffness)}, is at B = ${B(facts.peak.damping)}. Above ${B(facts.damping_ceiling)} the damper alone makes the servo oscillate.</p>
      <p>${seen({ free })} In the map below, the dot moves along B.</p>`,
  },
  {
    title: "The guard",
    scene: "stiff",
    tries: [["stiff", "The stiff wall"], ["far", "Far too stiff"], ["late", "More delay"], ["too_much", "Too much damping"]],
    text: ({ free, guarded, limits, commanded }) => `
      <p>Both servos get the request K = ${K(guarded.facts.asked.stiffness)} and B = ${B(guarded.facts.asked.damping)}. The guard knows bounds of inertia, friction and delay. It computes the limits, the curves of the map, and commands at most <b>${number(limits?.margin)}</b> of the lowest: K = ${K(commanded.stiffness)}, B = ${B(commanded.damping)}.</p>
      <p>Measured now: without the guard the servo <b>${does(free)}</b>; with it the servo <b>${guarded.measured_hz ? `oscillates at ${number(guarded.measured_hz)} Hz` : "is calm"}</b>.${commanded.stiffness < 0.97 * limits?.commanded.stiffness ? " Now its wall is even softer, because ticks were late or its detector found an oscillation." : ""}</p>
      <p class="words">${escaped(limits?.reasons?.[0] ?? "")}</p>`,
  },
  {
    title: "Your own servo",
    scene: "soft",
    tries: [],
    text: () => `
      <p>Connect it, then type:</p>
      <pre>haptic-wall scan                                      # lists the servos on the bus
haptic-wall init my-testbed.yaml --from xm430-w350    # writes a configuration, to be edited
haptic-wall doctor my-testbed.yaml                    # finds the faults of the testbed
haptic-wall run my-testbed.yaml                       # renders a wall until Ctrl-C
haptic-wall commission my-testbed.yaml --out results  # measures the servo and its limits</pre>
      <p>Limits of your servo, computed by the same theory:</p>`,
  },
];

const escaped = (words) => words.replace(/[&<>]/g, (sign) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;" })[sign]);

// The limits of the reader's own servo.
export function ownText(told) {
  if (told.trouble) return escaped(told.trouble);
  const top = `The highest limit is ${K(told.peak.stiffness)}, at B = ${B(told.peak.damping)}; above B = ${B(told.damping_ceiling)} no wall is stable.`;
  if (!told.exact) return `With this B no stiffness is stable. ${top}`;
  return `A two-sided wall is stable below K = ${K(told.exact)}, where it oscillates at ${Hz(told.frequency_hz)}; a one-sided wall below ${K(told.one_sided)}; ${told.passive ? `a wall is passive below ${K(told.passive)}` : "with this B no wall is passive"}. ${top}`;
}

