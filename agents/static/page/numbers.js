// Numbers: unpacked, bounded, and as text.

'use strict';

const byId = (id) => document.getElementById(id);
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
const mix = (a, b, share) => a + (b - a) * share;

// Little-endian numbers of single precision, from base64.
function unpacked(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Float32Array(bytes.buffer);
}

// A cost of transport with three digits; a dash where there is none.
function costText(cot) {
  if (!Number.isFinite(cot) || cot <= 0) return '–';
  return cot >= 10 ? cot.toFixed(0) : cot >= 1 ? cot.toFixed(2) : cot.toFixed(3);
}

const fixed = (x, digits) => (Math.abs(x) < 0.5 * 10 ** -digits ? 0 : x).toFixed(digits).replace('-', '−');
