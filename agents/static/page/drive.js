// The race: you against the policy, on a machine that you may change. The first level is slow, and
// you take over a wheel that walks; in the second you start from rest.

const LEVELS = { walking: { race: 15, pace: 0.5 }, rest: { race: 30, pace: 1 } }; // s; of the clock
const WALKS = 8; // s after which the policy walks, from rest
const PUSH = 3; // V that an arrow key adds to coasting; with Shift as much as there is
const HINT = 1.5; // V off coasting that are worth a key

const drive = {
  machine: { ...DATA.machine },
  level: LEVELS.walking,
  phase: 'ready', // then 'racing', then 'done'
  held: { keys: new Set(), strong: false, lever: null },
  left: LEVELS.walking.race,
};

// The voltage that is held (V), or null where nothing is: then the motor coasts.
function heldVoltage() {
  const { keys, strong, lever } = drive.held;
  if (lever !== null) return lever;
  if (keys.size !== 1) return keys.size ? 0 : null;
  const limit = drive.machine.voltage_limit;
  const push = (keys.has('ArrowRight') ? 1 : -1) * (strong ? 2 * limit : PUSH);
  return clamp(coasting(drive.you.state, drive.you.p) + push, -limit, limit);
}

// The voltage at which no current flows.
function coasting({ dphi, dtheta }, p) {
  const limit = drive.machine.voltage_limit;
  return clamp(wheel.motor_voltage(wheel.relative_rate(dphi, dtheta, p), 0, p), -limit, limit);
}

function newRace() {
  const { machine } = drive;
  const policy = (state, p) => policyVoltage(state, p, machine);
  let begin = null;
  if (drive.level === LEVELS.walking) {
    const before = new Walker(machine, policy);
    before.follow(WALKS);
    begin = { ...before.state, foot: 0 };
  }
  drive.you = new Walker(machine, (state, p) => heldVoltage() ?? coasting(state, p), begin);
  drive.policy = new Walker(machine, policy, begin);
  Object.assign(drive, { phase: 'ready', left: drive.level.race, seenFalls: 0, metres: 0, messageAt: drive.level.race });
  byId('start').textContent = 'Start';
  byId('share').disabled = true;
  byId('copied').textContent = '';
  showMessage('');
}

function start() {
  newRace();
  drive.phase = 'racing';
  byId('start').textContent = 'Start again';
  showMessage('Go!');
  byId('lever').focus({ preventScroll: true });
}

function finish() {
  drive.phase = 'done';
  byId('share').disabled = false;
  showMessage(result());
}

const showMessage = (text) => {
  if (byId('message').textContent !== text) byId('message').textContent = text;
};

const altered = () => Object.keys(DATA.machine).some((name) => drive.machine[name] !== DATA.machine[name]);

const ofFalls = (falls) => (falls ? `, ${falls} ${falls === 1 ? 'fall' : 'falls'}` : '');

const times = (ratio) => (ratio >= 10 ? ratio.toFixed(0) : ratio.toFixed(1));

// -- every frame ------------------------------------------------------------------------------

// Before a race, the policy walks alone, to show what it makes of the machine.
function followDrive(seconds) {
  const { you, policy, phase } = drive;
  if (phase === 'ready') policy.follow(seconds);
  if (phase !== 'racing') return;
  const step = Math.min(seconds * drive.level.pace, drive.left);
  you.follow(step);
  policy.follow(step);
  drive.left -= step;
  if (you.falls > drive.seenFalls) {
    drive.seenFalls = you.falls;
    showMessage('The foot lifted off: you fell. Start again, or get up by pumping.');
    drive.messageAt = drive.left;
  } else if (you.distance >= drive.metres + 1) {
    drive.metres += 1;
    showMessage(drive.metres === 1 ? 'The first metre!' : `${drive.metres} metres`);
    drive.messageAt = drive.left;
  } else if (you.distance < drive.metres - 0.3) {
    showMessage('You roll backward: only metres to the right count.');
  } else if (drive.messageAt - drive.left > 2) showMessage('');
  if (drive.left <= 1e-9) finish();
}

function drawDrive() {
  const { you, policy, phase, machine } = drive;
  const watched = phase === 'ready' ? policy : you;
  const trail = ({ samples, p }) => samples.slice(-50).map(({ pose }) => bobOf(pose, p));
  const glow = ({ samples }) => samples[samples.length - 1].power / 20;
  const scene = byId('drive-scene');
  drawScene(scene, [
    { pose: policy.shown, p: policy.p, colour: COLOURS.ghost, ghost: true, trail: trail(policy) },
    { pose: you.shown, p: you.p, colour: COLOURS.you, trail: trail(you), glow: glow(you) },
  ], watched.shown.x, machine.slope);
  const { width, height } = scene.getBoundingClientRect();
  drawAway(scene.getContext('2d'), width, height, policy.shown.x - you.shown.x, halfView(scene, you.p), phase === 'ready');
  drawStrips(byId('drive-strips'), watched.samples, machine.voltage_limit, 12);
  byId('message').setAttribute('aria-live', phase === 'ready' ? 'off' : 'polite');
  byId('whose').textContent = phase === 'ready' ? "The policy's" : 'Your';
  byId('clock').textContent = `${fixed(Math.max(drive.left, 0), 1)} s`;
  if (phase === 'ready') {
    const { speed, cot } = policy.recent(KEPT);
    showMessage(policy.time < KEPT ? 'The policy tries your machine …' : `The policy on this machine: ${fixed(speed, 2)} m/s, cost ${costText(cot)}${ofFalls(policy.falls)}`);
  }
  showScores();
  showLever();
}

// Who is out of the picture, and how far.
function drawAway(ctx, width, height, ahead, half, policyInMiddle) {
  const away = policyInMiddle ? -ahead : ahead;
  if (Math.abs(away) < half + 0.2) return;
  const ratio = ctx.canvas.width / width;
  ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
  ctx.font = `600 14px ${FONT}`;
  ctx.fillStyle = policyInMiddle ? COLOURS.you : COLOURS.ghost;
  ctx.textBaseline = 'middle';
  ctx.textAlign = away > 0 ? 'right' : 'left';
  const text = `${policyInMiddle ? 'you' : 'policy'} ${fixed(Math.abs(away), 1)} m`;
  ctx.fillText(away > 0 ? `${text} ▶` : `◀ ${text}`, away > 0 ? width - 14 : 14, height * 0.5);
}

function showLever() {
  const limit = drive.machine.voltage_limit;
  const volts = heldVoltage();
  const lever = byId('lever');
  const across = (v) => 50 + (50 * clamp(v, -limit, limit)) / limit;
  const shown = volts ?? 0;
  const [low, high] = [across(Math.min(shown, 0)), across(Math.max(shown, 0))];
  Object.assign(lever.querySelector('.fill').style, { left: `${low}%`, width: `${high - low}%` });
  const { state, p } = drive.you;
  const [free, wise] = [coasting(state, p), policyVoltage(state, p, drive.machine)];
  lever.querySelector('.emf').style.left = `${across(free)}%`;
  lever.querySelector('.law').style.left = `${across(wise)}%`;
  const hint = Math.abs(wise - free) < HINT ? 'let go' : wise > free ? 'now →' : '← now';
  const held = volts === null ? '' : `, you hold ${fixed(volts, 1)} V of ${limit}`;
  lever.querySelector('.text').textContent = drive.phase === 'racing' ? hint + held : 'hold here, left or right';
  lever.setAttribute('aria-valuenow', shown.toFixed(1));
}

// -- hands -----------------------------------------------------------------------------------

function setUpDrive() {
  const [lever, gear] = [byId('lever'), byId('gear')];
  let visible = false;
  new IntersectionObserver(([entry]) => { visible = entry.isIntersecting; }, { threshold: 0.3 })
    .observe(byId('race'));
  addEventListener('keydown', (event) => {
    drive.held.strong = event.shiftKey;
    const mine = event.key === 'ArrowLeft' || event.key === 'ArrowRight';
    if (!mine || !visible || event.target.matches('input[type=range]')) return;
    event.preventDefault();
    if (drive.phase === 'ready' && !event.repeat) start();
    drive.held.keys.add(event.key);
  });
  addEventListener('keyup', (event) => {
    drive.held.strong = event.shiftKey;
    drive.held.keys.delete(event.key);
  });
  addEventListener('blur', () => drive.held.keys.clear());
  const pull = (event) => {
    const { left, width } = lever.getBoundingClientRect();
    const limit = drive.machine.voltage_limit;
    drive.held.lever = clamp((2 * (event.clientX - left)) / width - 1, -1, 1) * limit;
  };
  lever.addEventListener('pointerdown', (event) => {
    lever.setPointerCapture(event.pointerId);
    if (drive.phase === 'ready') start();
    pull(event);
  });
  lever.addEventListener('pointermove', (event) => {
    if (drive.held.lever !== null) pull(event);
  });
  for (const end of ['pointerup', 'pointercancel', 'lostpointercapture']) {
    lever.addEventListener(end, () => { drive.held.lever = null; });
  }
  lever.addEventListener('contextmenu', (event) => event.preventDefault());
  byId('start').addEventListener('click', start);
  byId('rest').addEventListener('change', (event) => {
    drive.level = event.target.checked ? LEVELS.rest : LEVELS.walking;
    newRace();
  });
  byId('share').addEventListener('click', share);
  gear.value = DATA.machine.gear_ratio;
  for (const name of ['slope', 'gear', 'losses']) byId(name).addEventListener('input', changeMachine);
  byId('reset').addEventListener('click', resetMachine);
  resetMachine();
}
