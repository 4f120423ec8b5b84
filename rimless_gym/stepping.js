// The stepper: a wheel advanced at constant voltage, events located, energy accounted.
//
// It does what rimless_gym.kernel does, with an adaptive step: DOP853 between events, touchdowns
// found on the quintic through a step's ends and then by Newton's method on the step's length.
// Every equation, guard and reset map that it calls is printed from Python, and so is the tableau.

const STATES = 4; // phi, theta, phi', theta'; the losses follow them in a step's vector
const LOCATED = 1e-13; // rad: how near to its guard a located touchdown is
const TOLERANCE = { absolute: 1e-13, relative: 1e-12 };
const LONGEST = 2.5e-3; // s: so short that the quintics through a step's ends are accurate

const lossless = () => LOSSES.map(() => 0);

// A wheel at rest on two feet with the pendulum hanging still, along gravity.
const atRest = (p) => ({
  phi: p.a, theta: Math.atan2(p.gx, p.gy), dphi: 0, dtheta: 0, mode: DOUBLE, foot: 0,
});

// The constants of a machine, an object with the fields of WheelParams.
const constants = (machine) => {
  const mount = machine.motor_mount === 'wheel' ? 1 : 0;
  return constants_of(machine, mount, IMPACT_LAWS.indexOf(machine.impact_law), sin, cos);
};

// The rates of the state, and the powers of the LOSSES, in this order.
function rates(mode, y, u, p) {
  const [phi, theta, dphi, dtheta] = y;
  const [ddphi, ddtheta] = mode === DOUBLE
    ? [0, double_stance(phi, theta, dphi, dtheta, u, p)]
    : single_stance(phi, theta, dphi, dtheta, u, p);
  const [dpsi, ddpsi] = [relative_rate(dphi, dtheta, p), relative_rate(ddphi, ddtheta, p)];
  const powers = losses(dphi, dpsi, ddpsi, u, p);
  return [dphi, dtheta, ddphi, ddtheta, ...LOSSES.map((name) => powers[name])];
}

// One DOP853 step of length h from y, whose rates are known.
function attempt(mode, from, h, u, p) {
  const { y, k } = from;
  const stages = [k];
  for (let i = 1; i < A.length; i++) {
    const at = [y[0], y[1], y[2], y[3]];
    for (let j = 0; j < i; j++) {
      const w = h * A[i][j];
      if (w !== 0) for (let n = 0; n < STATES; n++) at[n] += w * stages[j][n];
    }
    stages.push(rates(mode, at, u, p));
  }
  const end = y.slice();
  for (let n = 0; n < y.length; n++) {
    let sum = 0;
    for (let j = 0; j < B.length; j++) sum += B[j] * stages[j][n];
    end[n] += h * sum;
  }
  const found = { y: end, k: rates(mode, end, u, p) };
  stages.push(found.k);
  return { ...found, h, stages };
}

// The error of a step in units of the tolerance.
function errorOf(from, { y, h, stages }) {
  let five = 0;
  let three = 0;
  for (let n = 0; n < STATES; n++) {
    const size = Math.max(Math.abs(from.y[n]), Math.abs(y[n]));
    const scale = TOLERANCE.absolute + TOLERANCE.relative * size;
    const sum = (weights) => weights.reduce((total, w, j) => total + w * stages[j][n], 0) / scale;
    five += sum(E5) ** 2;
    three += sum(E3) ** 2;
  }
  if (five === 0 && three === 0) return 0;
  return (h * five) / Math.sqrt((five + 0.01 * three) * STATES);
}

// -- quintics over a step, in s = t / h -------------------------------------------------------

function quintic(y0, v0, a0, y1, v1, a1, h) {
  const c1 = v0 * h;
  const c2 = 0.5 * a0 * h * h;
  const d = y1 - y0 - c1 - c2;
  const e = (v1 - v0 - a0 * h) * h;
  const f = 0.5 * (a1 - a0) * h * h;
  return [y0, c1, c2, 10 * d - 4 * e + f, -15 * d + 7 * e - 2 * f, 6 * d - 3 * e + f];
}

const value = (c, s) => c.reduceRight((sum, one) => sum * s + one, 0);
const derivative = (c) => c.slice(1).map((one, i) => (i + 1) * one);

// Where f changes sign between `low` and `high`, by bisection.
function crossing(f, low, high) {
  const rises = f(high) > 0;
  while (high - low > 1e-15) {
    const middle = 0.5 * (low + high);
    if (middle <= low || middle >= high) break;
    if (f(middle) > 0 === rises) high = middle;
    else low = middle;
  }
  return high;
}

// Where a polynomial that is positive at `end` comes up through zero. One that starts at zero and
// falls, as after a touchdown, has that root divided out.
function upwardRoot(c, end) {
  let rest = c;
  if (c[0] >= 0) {
    if (c[1] > 0 || (c[1] === 0 && c[2] >= 0)) return 0;
    rest = c.slice(1);
    if (rest[0] === 0) rest = rest.slice(1);
  }
  return crossing((s) => value(rest, s), 0, end);
}

// -- events ----------------------------------------------------------------------------------

// The first touchdown within a step: its direction, and fractions of the step near and past it.
function touchdownWithin(from, to, p) {
  let found = null;
  for (const direction of [1, -1]) {
    const past = (y) => touchdown_guard(direction, y[0], p);
    const rate = ({ k }) => [direction * k[0], direction * k[2]];
    const c = quintic(past(from.y), ...rate(from), past(to.y), ...rate(to), to.h);
    const slope = derivative(c);
    let end = 1;
    if (slope[0] > 0 && value(slope, 1) < 0) end = crossing((s) => value(slope, s), 0, 1);
    if (value(c, end) > 0.1 * LOCATED) {
      const near = upwardRoot(c, end);
      if (!found || near < found.near) found = { direction, near, end };
    }
  }
  return found;
}

// The step shortened so that it ends on the guard: Newton's method, bisection where that leaves
// the bracket.
function landing(from, to, { direction, near, end }, mode, u, p) {
  let [low, high, length] = [0, end * to.h, near * to.h];
  let tried = to;
  for (let tries = 0; tries < 60; tries++) {
    tried = attempt(mode, from, length, u, p);
    const miss = touchdown_guard(direction, tried.y[0], p);
    if (Math.abs(miss) <= LOCATED || high - low <= 1e-16) break;
    if (miss > 0) high = length;
    else low = length;
    const newton = length - miss / (direction * tried.y[2]);
    length = low < newton && newton < high ? newton : 0.5 * (low + high);
  }
  tried.y[0] = direction > 0 ? p.b : p.a;
  return tried;
}

const liftsOff = (y, u, p) => lift_off_guard(y[1], y[3], u, p) > 0;

const forceOn = ({ y, k }, p) => ground_reaction(y[0], y[1], y[2], y[3], k[2], k[3], p);

// The middle of a step, on the quintics through its ends.
function middleOf(from, to, mode, u, p) {
  const [angles, turns] = [[], []];
  for (const n of [0, 1]) {
    const ends = [from, to].flatMap(({ y, k }) => [y[n], y[n + 2], k[n + 2]]);
    const c = quintic(...ends, to.h);
    angles.push(value(c, 0.5));
    turns.push(value(derivative(c), 0.5) / to.h);
  }
  const y = [...angles, ...turns];
  return { y, k: rates(mode, y, u, p), h: 0.5 * to.h };
}

// The step shortened so that it ends where `happens` begins to hold.
function shortened(from, to, happens, mode, u, p) {
  const at = (length) => attempt(mode, from, length, u, p);
  return at(crossing((length) => (happens(at(length)) ? 1 : -1), 0, to.h));
}

// -- energy ----------------------------------------------------------------------------------

// Integrals of V i and of max(V i, 0) over a step, split where the current changes sign.
function work(from, to, u, p) {
  const turn = relative_rate(to.y[0] - from.y[0], to.y[1] - from.y[1], p);
  const [rate0, rate1] = [from, to].map(({ y }) => relative_rate(y[2], y[3], p));
  const [bend0, bend1] = [from, to].map(({ k }) => relative_rate(k[2], k[3], p));
  const c = quintic(0, rate0, bend0, turn, rate1, bend1, to.h);
  const slope = derivative(c);
  const current = (s) => motor_current(value(slope, s) / to.h, u, p);
  const done = (s) => u * motor_charge(value(c, s), u, to.h * s, p);
  const marks = [0, 1];
  const bend = derivative(slope);
  if (bend0 * bend1 < 0) marks.splice(1, 0, crossing((s) => value(bend, s), 0, 1));
  const cuts = [0];
  for (let i = 1; i < marks.length; i++) {
    const [low, high] = [marks[i - 1], marks[i]];
    if (current(low) * current(high) < 0) cuts.push(crossing(current, low, high));
  }
  const ends = [...cuts, 1].map((s) => (s === 1 ? u * motor_charge(turn, u, to.h, p) : done(s)));
  let positive = 0;
  for (let i = 1; i < ends.length; i++) positive += Math.max(ends[i] - ends[i - 1], 0);
  return { electrical: ends[ends.length - 1], positive };
}

const height = (y, foot, p) => mechanical_energy(y[0], y[1], y[2], y[3], p) - foot * descent(0, p);
const position = (y, foot, p) => hub_position(y[0], p)[0] + foot * p.chord;

// -- a control interval ----------------------------------------------------------------------

// Advance a wheel at the voltage u for a time.
//
// state: {phi, theta, dphi, dtheta, mode, foot}; it is left as it is.
// pull: largest force (N) with which the ground holds a foot down; 0 in the environment.
// Returns {state, totals}: sums, extremes and `touchdowns`, the times of the touchdowns (s).
function advance(state, u, duration, p, pull = 0) {
  const start = [state.phi, state.theta, state.dphi, state.dtheta];
  let { mode, foot } = state;
  let here = { y: [...start, ...lossless()] };
  let left = duration;
  let h = Math.min(1e-3, duration);
  let events = 0;
  const totals = {
    electrical: 0, electrical_positive: 0, collision: 0, touchdowns: [], failure: OK,
    min_normal_force: Infinity, friction_demand: 0, impulse_friction_demand: 0,
    clearance: Infinity,
  };
  const contact = (counts) => {
    const [fx, fy] = forceOn(here, p);
    if (counts || contact_guard(fy, pull) > 0) {
      totals.min_normal_force = Math.min(totals.min_normal_force, fy);
      totals.friction_demand = Math.max(totals.friction_demand, friction_demand(fx, fy));
    }
    totals.clearance = Math.min(totals.clearance, pendulum_clearance(here.y[0], here.y[1], p));
    if (contact_guard(fy, pull) > 0) totals.failure = CONTACT_LOST;
  };
  const restart = (newMode, newFoot, y) => {
    [mode, foot] = [newMode, newFoot];
    here = { y: [...y, ...here.y.slice(STATES)] };
    here.k = rates(mode, here.y, u, p);
    contact(mode === SINGLE || both_feet_press(y[1], y[3], u, p));
    events += 1;
    if (events > MAX_EVENTS * Math.max(1, duration / CONTROL_PERIOD)) {
      totals.failure = TOO_MANY_EVENTS;
    }
  };
  const liftOff = () => {
    const [phi, shift] = after_lift_off(here.y[1], here.y[3], u, p);
    restart(SINGLE, foot + shift, [phi, here.y[1], 0, here.y[3]]);
  };
  const touchDown = (direction) => {
    const { y } = here;
    const landed = after_touchdown(direction, y[1], y[2], y[3], u, p);
    if (!landed.legal) {
      totals.failure = THESIS_BACKWARD;
      return;
    }
    const after = [landed.phi, y[1], landed.dphi, landed.dtheta];
    totals.collision += height(y, 0, p) - height(after, landed.shift, p);
    const [before, now] = [y, after].map((one) => linear_momentum(...one.slice(0, STATES), p));
    const demand = friction_demand(now[0] - before[0], now[1] - before[1]);
    totals.impulse_friction_demand = Math.max(totals.impulse_friction_demand, demand);
    totals.touchdowns.push(duration - left);
    restart(landed.mode, foot + landed.shift, after);
  };

  here.k = rates(mode, here.y, u, p);
  contact(true);
  while (left > 0 && totals.failure === OK) {
    if (mode === DOUBLE && liftsOff(here.y, u, p)) {
      if (events === 0) [totals.min_normal_force, totals.friction_demand] = [Infinity, 0];
      liftOff();
      continue;
    }
    const length = Math.min(h, left, LONGEST);
    let next = attempt(mode, here, length, u, p);
    const error = errorOf(here, next);
    if (!(error < 1e6) && length < 1e-9) {
      totals.failure = DIVERGED;
      break;
    }
    const change = error === 0 ? 4 : Math.min(4, Math.max(0.2, 0.9 * error ** (-1 / 8)));
    h = length * (Number.isNaN(change) ? 0.2 : change);
    if (!(error <= 1)) continue;

    const touchdown = mode === SINGLE ? touchdownWithin(here, next, p) : null;
    let event = null;
    if (touchdown) {
      next = landing(here, next, touchdown, mode, u, p);
      event = () => touchDown(touchdown.direction);
    } else if (mode === DOUBLE && liftsOff(next.y, u, p)) {
      next = shortened(here, next, ({ y }) => liftsOff(y, u, p), mode, u, p);
      event = liftOff;
    }
    const released = (to) => contact_guard(forceOn(to, p)[1], pull) > 0;
    const first = [middleOf(here, next, mode, u, p), next].find(released);
    if (first) {
      next = shortened(here, first, released, mode, u, p);
      event = () => { totals.failure = CONTACT_LOST; };
    }

    const done = work(here, next, u, p);
    totals.electrical += done.electrical;
    totals.electrical_positive += done.positive;
    left = Math.max(0, left - next.h);
    if (left < 1e-15) left = 0;
    here = { y: next.y, k: next.k };
    const failure = totals.failure;
    contact(true);
    totals.failure = failure;
    if (event) event();
    if (Math.max(Math.abs(here.y[2]), Math.abs(here.y[3])) > MAX_RATE) {
      totals.failure = RATE_EXCEEDED;
    }
  }
  const [phi, theta, dphi, dtheta] = here.y;
  const losses = Object.fromEntries(LOSSES.map((name, i) => [name, here.y[STATES + i]]));
  const [fx, fy] = forceOn(here, p);
  Object.assign(totals, losses, {
    elapsed: duration - left,
    distance: position(here.y, foot, p) - position(start, state.foot, p),
    steps: foot - state.foot,
    mechanical_change: height(here.y, foot, p) - height(start, state.foot, p),
    force_x: fx,
    force_y: fy,
  });
  return { state: { phi, theta, dphi, dtheta, mode, foot }, totals };
}

return {
  constants, advance, atRest, rates, observation, after_touchdown, relative_rate, motor_voltage,
  hub_position, CONTROL_PERIOD, LOSSES, OK, SINGLE, DOUBLE,
};
