// Voltage, power and energy over the last seconds, drawn as they go.

const SHOWN = 3; // s

// samples: {t, voltage, power, energy, landed}, in order of time. limit: of the voltage (V).
// peak: power (W) at the top of its row, or more where the samples exceed it.
function drawStrips(canvas, samples, limit, peak) {
  const { ctx, width, height } = cleared(canvas);
  const now = samples[samples.length - 1];
  const seen = samples.filter(({ t }) => t >= now.t - SHOWN - 0.05);
  const top = Math.max(peak, ...seen.map(({ power }) => power));
  const [least, most] = [seen[0].energy, now.energy];
  const rows = [
    { name: 'voltage', text: `${fixed(now.voltage, 1)} V`, low: -limit, high: limit, colour: COLOURS.you },
    { name: 'power', text: `${fixed(now.power, 1)} W`, low: 0, high: top, colour: COLOURS.pendulum },
    { name: 'energy', text: `${fixed(now.energy, 1)} J`, low: least, high: Math.max(most, least + 0.5), colour: COLOURS.whirl },
  ];
  const left = 82;
  const across = (t) => left + ((t - now.t + SHOWN) / SHOWN) * (width - left - 6);
  const tall = height / rows.length;
  ctx.strokeStyle = COLOURS.line;
  ctx.lineWidth = 1;
  for (const { t } of seen.filter(({ landed, t: at }) => landed && at > now.t - SHOWN)) {
    ctx.beginPath();
    ctx.moveTo(across(t), 0);
    ctx.lineTo(across(t), height);
    ctx.stroke();
  }
  rows.forEach((row, i) => {
    const [roof, floor] = [i * tall + 7, (i + 1) * tall - 7];
    const up = (value) => floor - ((value - row.low) / (row.high - row.low)) * (floor - roof);
    ctx.fillStyle = COLOURS.soft;
    ctx.textAlign = 'left';
    ctx.textBaseline = 'alphabetic';
    ctx.font = `13px ${FONT}`;
    ctx.fillText(row.name, 0, (roof + floor) / 2 - 4);
    ctx.fillStyle = row.colour;
    ctx.font = `600 16px ${FONT}`;
    ctx.fillText(row.text, 0, (roof + floor) / 2 + 15);
    const zero = up(clamp(0, row.low, row.high));
    ctx.strokeStyle = COLOURS.line;
    ctx.lineWidth = 1;
    ctx.beginPath();
    ctx.moveTo(left, zero);
    ctx.lineTo(width - 6, zero);
    ctx.stroke();
    ctx.save();
    ctx.beginPath();
    ctx.rect(left, roof - 4, width - left, floor - roof + 8);
    ctx.clip();
    ctx.beginPath();
    seen.forEach((sample, k) => ctx[k ? 'lineTo' : 'moveTo'](across(sample.t), up(sample[row.name])));
    ctx.strokeStyle = row.colour;
    ctx.lineWidth = 2;
    ctx.stroke();
    if (row.name !== 'voltage') {
      ctx.lineTo(across(now.t), floor);
      ctx.lineTo(across(seen[0].t), floor);
      ctx.globalAlpha = 0.18;
      ctx.fillStyle = row.colour;
      ctx.fill();
      ctx.globalAlpha = 1;
    }
    ctx.restore();
    ctx.fillStyle = row.colour;
    ctx.beginPath();
    ctx.arc(across(now.t), clamp(up(now[row.name]), roof - 2, floor + 2), 3.5, 0, 7);
    ctx.fill();
  });
}
