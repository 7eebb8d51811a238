// What a figure is called, how it is written, and which way is better.

const sizes = ['bytes', 'KiB', 'MiB', 'GiB', 'TiB'];

function digits(value, count) {
  if (value === 0) return '0';
  const places = count - 1 - Math.floor(Math.log10(Math.abs(value)));
  if (places > 9) return value.toExponential(count - 1);
  return places > 0 ? value.toFixed(places) : String(Math.round(value));
}

function bytesText(value) {
  let unit = 0;
  while (value >= 1024 && unit + 1 < sizes.length) {
    value /= 1024;
    ++unit;
  }
  return `${unit === 0 ? value : digits(value, 3)} ${sizes[unit]}`;
}

function scaledText(value) {
  for (const [factor, letter] of [[1e9, 'G'], [1e6, 'M'], [1e3, 'k']]) {
    if (Math.abs(value) >= factor) return `${digits(value / factor, 3)} ${letter}`;
  }
  return digits(value, 3);
}

function secondsText(value) {
  if (value < 1) return `${digits(value * 1000, 3)} ms`;
  return `${digits(value, 3)} s`;
}

const significant = (count) => (value) => digits(value, count);
const decibels = (value) => `${value.toFixed(2)} dB`;

// `filter`: the unit in which ranges are asked for, and its size.
const figures = [
  {id: 'file_size', label: 'Size', better: -1, log: true, text: bytesText, filter: ['KiB', 1024]},
  {id: 'ratio', label: 'Ratio', better: 1, log: true, text: significant(4), filter: ['', 1]},
  {id: 'rmse', label: 'RMSE', better: -1, log: true, text: significant(3), filter: ['', 1]},
  {id: 'psnr', label: 'PSNR', better: 1, log: false, text: decibels, filter: ['dB', 1]},
  {id: 'snr', label: 'SNR', better: 1, log: false, text: decibels, filter: ['dB', 1]},
  {id: 'relative', label: 'Relative error', better: -1, log: true, text: significant(3),
   filter: ['', 1]},
  {id: 'max_error', label: 'Largest error', better: -1, log: true, text: significant(3),
   filter: ['', 1]},
  {id: 'ssim', label: 'SSIM', better: 1, log: false, text: (value) => value.toFixed(4),
   filter: ['', 1]},
  {id: 'weighted_psnr', label: 'Weighted PSNR', better: 1, log: false, text: decibels,
   filter: ['dB', 1]},
  {id: 'weighted_snr', label: 'Weighted SNR', better: 1, log: false, text: decibels,
   filter: ['dB', 1]},
  {id: 'log_rmse', label: 'Log RMSE', better: -1, log: true, text: significant(3), filter: ['', 1]},
  {id: 'log_snr', label: 'Log SNR', better: 1, log: false, text: decibels, filter: ['dB', 1]},
  {id: 'encode_time', label: 'Encode time', better: -1, log: true, text: secondsText,
   filter: ['s', 1]},
  {id: 'image_rate', label: 'Images/s', better: 1, log: true, text: scaledText, filter: ['/s', 1]},
  {id: 'texel_rate', label: 'Texels/s', better: 1, log: true, text: scaledText, filter: ['/s', 1]},
  {id: 'lookup_rate', label: 'Look-ups/s', better: 1, log: true, text: scaledText,
   filter: ['/s', 1]},
  {id: 'peak_memory', label: 'Peak memory', better: -1, log: true, text: bytesText,
   filter: ['MiB', 1048576]},
];
const figureOf = Object.fromEntries(figures.map((figure) => [figure.id, figure]));

// Infinities are texts in JSON; what was not measured is NaN here.
function valueOf(point, id) {
  const value = point.figures[id];
  if (value === 'inf') return Infinity;
  if (value === '-inf') return -Infinity;
  return typeof value === 'number' ? value : NaN;
}

function textOf(point, id) {
  const value = valueOf(point, id);
  if (Number.isNaN(value)) return '–';
  return Number.isFinite(value) ? figureOf[id].text(value) : value > 0 ? '∞' : '−∞';
}

// The points that no other beats in one of two figures without losing in the other.
function paretoFront(points, x, y) {
  const gain = (point, id) => figureOf[id].better * valueOf(point, id);
  const sorted = [...points].sort((a, b) => gain(b, x) - gain(a, x) || gain(b, y) - gain(a, y));
  let best = -Infinity;
  return sorted.filter((point) => {
    if (gain(point, y) <= best) return false;
    best = gain(point, y);
    return true;
  });
}

// Elements with attributes, text and children; text is never read as markup.
function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

function drawn(name, attributes = {}, ...children) {
  const made = document.createElementNS('http://www.w3.org/2000/svg', name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

// Every codec has a colour and a shape of its own.
const shapes = [
  'M0,-5A5,5,0,1,1,0,5A5,5,0,1,1,0,-5Z',
  'M-4.5,-4.5H4.5V4.5H-4.5Z',
  'M0,-5.6L5.4,4.2H-5.4Z',
  'M0,-6.2L6.2,0L0,6.2L-6.2,0Z',
  'M0,5.6L5.4,-4.2H-5.4Z',
  'M-1.9,-5.6H1.9V-1.9H5.6V1.9H1.9V5.6H-1.9V1.9H-5.6V-1.9H-1.9Z',
  'M-3,-5.2H3L6,0L3,5.2H-3L-6,0Z',
  'M0,-6.4L1.7,-1.9H6.4L2.6,1.1L4,5.6L0,2.9L-4,5.6L-2.6,1.1L-6.4,-1.9H-1.7Z',
];
const colour = (index) => `var(--c${index % 8})`;
const shape = (index) => shapes[index % shapes.length];

function swatch(index) {
  return drawn('svg', {viewBox: '-8 -8 16 16', 'aria-hidden': 'true'},
               drawn('path', {d: shape(index), fill: colour(index)}));
}
