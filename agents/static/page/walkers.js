// What walks: gaits played back, and simulated wheels. Both give poses and samples.
//
// A pose is {x, y, turned, theta, mode}: the hub in the ground's frame (m), the wheel's angle
// counted through all steps, the pendulum's angle, and the stance mode.

const TICK = wheel.CONTROL_PERIOD;
const KEPT = 6; // s: how much of the past is kept for trails and strips

function poseOf({ phi, theta, mode, foot }, p) {
  const [x, y] = wheel.hub_position(phi, p);
  return { x: x + foot * p.chord, y, turned: phi + foot * p.alpha, theta, mode };
}

function bobOf({ x, y, theta }, p) {
  return [x + p.L2 * Math.sin(theta), y - p.L2 * Math.cos(theta)];
}

// -- gaits of the front ---------------------------------------------------------------------

const CONSTANTS = wheel.constants(DATA.machine);

const GAITS = DATA.front.map((gait) => {
  const numbers = unpacked(gait.samples);
  const length = gait.counts.reduce((a, b) => a + b, 0);
  const columns = Object.fromEntries(
    DATA.columns.map((name, i) => [name, numbers.subarray(i * length, (i + 1) * length)]),
  );
  const duration = gait.durations.reduce((a, b) => a + b, 0);
  const starts = gait.durations.map((_, i) => gait.durations.slice(0, i).reduce((a, b) => a + b, 0));
  const offsets = gait.counts.map((_, i) => gait.counts.slice(0, i).reduce((a, b) => a + b, 0));
  const energy = columns.energy[length - 1];
  const peak = columns.power.reduce((a, b) => Math.max(a, b), 0);
  return { ...gait, columns, duration, starts, offsets, energy, peak };
});

// A gait at the time t (s), as a state with voltage (V), power (W) and energy since t = 0 (J).
function gaitAt(gait, t, p = CONSTANTS) {
  const stride = Math.floor(t / gait.duration);
  const within = clamp(t - stride * gait.duration, 0, gait.duration);
  let step = gait.starts.length - 1;
  while (step > 0 && gait.starts[step] > within) step -= 1;
  const share = clamp((within - gait.starts[step]) / gait.durations[step], 0, 1);
  const place = share * (gait.counts[step] - 1);
  const before = Math.min(Math.floor(place), gait.counts[step] - 2);
  const at = Object.fromEntries(
    DATA.columns.map((name) => {
      const column = gait.columns[name];
      const i = gait.offsets[step] + before;
      return [name, mix(column[i], column[i + 1], place - before)];
    }),
  );
  at.theta += 2 * Math.PI * gait.turns * stride;
  at.energy += gait.energy * stride;
  const foot = stride * gait.starts.length + step;
  return { ...at, t, mode: wheel.SINGLE, foot, pose: poseOf({ ...at, foot, mode: wheel.SINGLE }, p) };
}

// -- simulated wheels -------------------------------------------------------------------------

// A wheel on a machine, from a state, by default at rest. `control(state, p)` gives the voltage of
// the next 10 ms. Where the foot would have to be pulled down, the wheel falls: it is set upright
// again, at rest.
class Walker {
  constructor(machine, control, begin = null) {
    Object.assign(this, { machine, control, p: wheel.constants(machine) });
    this.state = begin ?? wheel.atRest(this.p);
    Object.assign(this, { time: 0, energy: 0, distance: 0, falls: 0, debt: 0, samples: [] });
    this.pose = poseOf(this.state, this.p);
    this.before = this.pose;
    this.note(0, 0);
  }

  note(voltage, power, landed = false) {
    const { time: t, energy, distance, pose, state } = this;
    this.samples.push({ t, voltage, power, energy, distance, pose, foot: state.foot, landed });
    if (this.samples.length > 2 * KEPT / TICK) this.samples.splice(0, KEPT / TICK);
  }

  tick() {
    const voltage = this.control(this.state, this.p);
    const { state, totals } = wheel.advance(this.state, voltage, TICK, this.p);
    const drawn = totals.electrical_positive + this.machine.idle_power * TICK;
    this.energy += drawn;
    this.distance += totals.distance;
    this.time += TICK;
    this.state = state;
    if (totals.failure !== wheel.OK) this.fall();
    this.before = this.pose;
    this.pose = poseOf(this.state, this.p);
    if (totals.failure !== wheel.OK) this.before = this.pose;
    this.note(voltage, drawn / TICK, totals.touchdowns.length > 0);
  }

  fall() {
    const { x } = poseOf(this.state, this.p);
    const rest = wheel.atRest(this.p);
    const foot = Math.round((x - wheel.hub_position(rest.phi, this.p)[0]) / this.p.chord);
    this.state = { ...rest, foot };
    this.falls += 1;
  }

  // Follow the clock for `seconds`; what is shorter than a tick is owed.
  follow(seconds) {
    this.debt += seconds;
    while (this.debt >= TICK) {
      this.tick();
      this.debt -= TICK;
    }
  }

  // The pose between the last two ticks that fits the clock, so that drawings move evenly.
  get shown() {
    const share = this.debt / TICK;
    const shown = { mode: this.pose.mode };
    for (const name of ['x', 'y', 'turned', 'theta']) {
      shown[name] = mix(this.before[name], this.pose[name], share);
    }
    return shown;
  }

  // Speed and cost of transport over the last `seconds`.
  recent(seconds) {
    const now = this.samples[this.samples.length - 1];
    const then = this.samples.find(({ t }) => t >= now.t - seconds - 1e-9);
    return this.figures(now.t - then.t, now.distance - then.distance, now.energy - then.energy);
  }

  // The same since the start.
  get overall() {
    return this.figures(this.time, this.distance, this.energy);
  }

  figures(time, distance, energy) {
    const speed = time > 0 ? distance / time : 0;
    const cot = distance > 0.02 ? energy / (this.machine.weight * distance) : Infinity;
    return { time, distance, energy, speed, cot };
  }
}
