// Scales: from the values of an axis to places on the screen, and where its ticks are.

const decades = (x, threshold) => (Math.abs(x) <= threshold ? x / threshold : Math.sign(x) * (1 + Math.log10(Math.abs(x) / threshold)));

const TRANSFORMS = {
  linear: (x) => x,
  log: (x) => (x > 0 ? Math.log10(x) : NaN),
  symlog: decades,
};

// Ticks at 1, 2 and 5 times a power of ten, or only at the powers where there are many.
function roundedTicks(low, high, count) {
  const raw = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].find((k) => k * power >= raw) * power;
  const ticks = [];
  for (let k = Math.ceil(low / step - 1e-9); k <= high / step + 1e-9; k++) ticks.push(Number((k * step).toPrecision(12)));
  return ticks;
}

function decadeTicks(low, high, least, count) {
  const first = Math.floor(Math.log10(least));
  const last = Math.ceil(Math.log10(Math.max(Math.abs(low), Math.abs(high), least)));
  for (const factors of [[1, 2, 5], [1]]) {
    for (const every of [1, 2, 3]) {
      const sizes = [];
      for (let k = first; k <= last; k += every) sizes.push(...factors.map((f) => Number((f * 10 ** k).toPrecision(3))));
      const ticks = sizes.filter((x) => x >= least * 0.999).flatMap((x) => [x, -x]).filter((x) => x >= low && x <= high);
      if (ticks.length <= count) return ticks;
      if (factors.length > 1) break;
    }
  }
  return [];
}

// A scale for an axis whose values lie between two; `from` and `to` are places on the screen.
function scaled({ scale, threshold, limits }, values, from, to, count) {
  const known = values.filter((x) => Number.isFinite(TRANSFORMS[scale](x, threshold)));
  let [low, high] = limits ?? [Math.min(...known), Math.max(...known)];
  if (!known.length && !limits) [low, high] = [0, 1];
  const move = (x) => TRANSFORMS[scale](x, threshold);
  let [a, b] = [move(low), move(high)];
  if (!limits) {
    const room = 0.05 * (b - a || Math.abs(a) || 1);
    [a, b] = [a - room, b + room];
  }
  const place = (x) => from + ((move(x) - a) / (b - a)) * (to - from);
  const most = 1e-4 * (b - a); // numbers of single precision may lie just outside
  const within = (x) => move(x) >= a - most && move(x) <= b + most;
  let ticks = roundedTicks(a, b, count);
  if (scale === 'log') ticks = decadeTicks(10 ** a, 10 ** b, 10 ** a, count);
  if (scale === 'symlog') ticks = [0, ...decadeTicks(low, high, threshold, count)];
  return { place, ticks: ticks.filter(within), within };
}

// A number as its axis writes it: as short as it can be read.
function tickText(x) {
  const size = Math.abs(x);
  if (x === 0) return '0';
  if (size >= 1e9) return `${Number((x / 1e9).toPrecision(3))} G`.replace('-', '−');
  if (size >= 1e6) return `${Number((x / 1e6).toPrecision(3))} M`.replace('-', '−');
  if (size >= 1e4) return `${Number((x / 1e3).toPrecision(3))} k`.replace('-', '−');
  return (size < 1e-3 ? x.toExponential(0) : `${Number(x.toPrecision(4))}`).replace('-', '−');
}

// A value with the digits that can be read off it.
function valueText(x) {
  const size = Math.abs(x);
  const text = size && (size < 1e-3 || size >= 1e6) ? x.toExponential(3) : `${Number(x.toPrecision(5))}`;
  return text.replace('-', '−');
}
