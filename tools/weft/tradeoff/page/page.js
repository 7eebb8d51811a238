// What is shown, and what happens when that is changed.

const data = JSON.parse(document.getElementById('data').textContent);
const byId = (id) => document.getElementById(id);
const codecs = [...new Set(data.points.map((point) => point.codec))];
const materials = Object.fromEntries(data.materials.map((material) => [material.name, material]));
for (const point of data.points) {
  point.optionText = point.options.join(' ').replace(/--/g, '');
  point.searched = `${point.material} ${point.codec} ${point.optionText}`.toLowerCase().split(/\s+/);
}

const knownFigures = figures.filter((f) => data.points.some((point) => f.id in point.figures));

const state = {
  material: '', x: 'file_size', y: 'psnr', xLog: true, yLog: false, hidden: new Set(), text: '',
  ranges: {}, chosen: null, sort: {id: 'file_size', direction: 1},
};

// All words must begin a word of the point; figures lie within their ranges.
function passes(point) {
  if (state.material && point.material !== state.material) return false;
  if (state.hidden.has(point.codec)) return false;
  const words = state.text.toLowerCase().split(/\s+/).filter(Boolean);
  const begins = (word) => point.searched.some((searched) => searched.startsWith(word));
  if (!words.every(begins)) return false;
  return Object.entries(state.ranges).every(([id, [low, high]]) => {
    const value = valueOf(point, id);
    return !(Number.isNaN(value)) && value >= low && value <= high;
  });
}

function drawPlots(points) {
  const shown = state.material ? [materials[state.material]] : data.materials;
  const x = {figure: figureOf[state.x], log: state.xLog};
  const y = {figure: figureOf[state.y], log: state.yLog};
  // the same scales in all panels
  const plotted = points.filter((point) => canPlot(point, x, y));
  x.values = plotted.map((point) => valueOf(point, x.figure.id));
  y.values = plotted.map((point) => valueOf(point, y.figure.id));
  const focused = document.activeElement?.closest?.('.mark')?.getAttribute('data-key');
  const plots = byId('plots');
  plots.replaceChildren(...shown.map(() => element('div')));  // so that columns have their widths
  plots.replaceChildren(...shown.map((material) => makePanel(
      material, points.filter((point) => point.material === material.name), x, y, codecs,
      state.chosen, choose)));
  if (focused) plots.querySelector(`.mark[data-key="${focused}"]`)?.focus();
}

function drawTable(points) {
  drawHead(byId('table').tHead, state.sort, (id) => {
    const same = state.sort.id === id;
    // the better values first
    const first = figureOf[id]?.better > 0 ? -1 : 1;
    state.sort = {id, direction: same ? -state.sort.direction : first};
    drawTable(data.points.filter(passes));
  });
  byId('table').tBodies[0].replaceChildren(
      ...sortPoints(points, state.sort).map((p) => drawRow(p, codecs, state.chosen, choose)));
  const unmet = points.filter((point) => point.status === 1).length;
  const failed = points.filter((point) => point.status > 1).length;
  byId('count').textContent = `${points.length} of ${data.points.length}` +
      (unmet ? `, ${unmet} with goals that are not met` : '') + (failed ? `, ${failed} failed` : '');
}

function draw() {
  hideTip();
  const points = data.points.filter(passes);
  drawPlots(points);
  drawTable(points);
  const ranges = Object.keys(state.ranges).length;
  byId('range-count').textContent = ranges ? ` (${ranges} in use)` : '';
}

function choose(key) {
  state.chosen = key;
  const point = data.points.find((p) => p.key === key);
  drawDetail(byId('detail'), point, point && materials[point.material],
             point ? codecs.indexOf(point.codec) : 0);
  for (const item of document.querySelectorAll('[data-key]')) {
    item.classList.toggle('chosen', item.getAttribute('data-key') === key && item.id !== 'detail');
  }
}

// --- controls ---

function fillAxes() {
  for (const axis of ['x', 'y']) {
    const choice = byId(`${axis}-axis`);
    choice.append(...knownFigures.map((figure) => element('option', {value: figure.id}, figure.label)));
    choice.value = state[axis];
    const log = byId(`${axis}-log`);
    log.checked = state[`${axis}Log`];
    choice.addEventListener('change', () => {
      state[axis] = choice.value;
      log.checked = state[`${axis}Log`] = figureOf[choice.value].log;
      draw();
    });
    log.addEventListener('change', () => {
      state[`${axis}Log`] = log.checked;
      draw();
    });
  }
}

function fillMaterials() {
  byId('material').append(element('option', {value: ''}, 'all'),
                          ...data.materials.map((m) => element('option', {value: m.name}, m.name)));
  byId('material').addEventListener('change', () => {
    state.material = byId('material').value;
    draw();
  });
}

function fillCodecs() {
  const group = byId('codecs');
  codecs.forEach((codec, index) => {
    const button = element('button', {type: 'button', 'aria-pressed': 'true', 'data-codec': codec},
                           swatch(index), codec);
    button.addEventListener('click', () => {
      const hide = !state.hidden.has(codec);
      hide ? state.hidden.add(codec) : state.hidden.delete(codec);
      button.setAttribute('aria-pressed', String(!hide));
      draw();
    });
    group.append(button);
  });
  const line = drawn('svg', {viewBox: '0 0 16 16', 'aria-hidden': 'true'},
                     drawn('path', {class: 'front-all', d: 'M3,8H13'}));
  group.append(element('span', {class: 'key'}, line, 'the best of all codecs'));
}

function fillRanges() {
  for (const figure of knownFigures) {
    const [unit, size] = figure.filter;
    const field = element('fieldset', {}, element('legend', {},
                                                  figure.label + (unit && unit !== '/s' ? `, ${unit}` : '')));
    const inputs = ['from', 'to'].map((end) => element('input', {
      type: 'number', step: 'any', 'data-range': `${figure.id}-${end}`,
      'aria-label': `${figure.label} ${end}`}));
    for (const input of inputs) {
      input.addEventListener('input', () => {
        const [low, high] = inputs.map((i) => i.value === '' ? NaN : Number(i.value) * size);
        delete state.ranges[figure.id];
        if (!Number.isNaN(low) || !Number.isNaN(high)) {
          state.ranges[figure.id] = [Number.isNaN(low) ? -Infinity : low,
                                     Number.isNaN(high) ? Infinity : high];
        }
        draw();
      });
    }
    field.append(inputs[0], '–', inputs[1]);
    byId('range-fields').append(field);
  }
}

function fillTexts() {
  const count = (n, what) => `${n} ${what}${n === 1 ? '' : 's'}`;
  byId('summary').textContent = `${count(data.points.length, 'point')} of ` +
      `${count(codecs.length, 'codec')} on ${count(data.materials.length, 'material')}; weft ` +
      `${data.program_version}${data.device ? `, ${data.device}` : ''}`;
  byId('notes').append(
      element('p', {}, data.materials.map((m) => `${m.name}: ${m.shape[0]} views × ${m.shape[1]} ` +
          `lights × ${m.shape[2]} × ${m.shape[3]} texels × ${m.shape[4]} channels, ${m.dtype}`)
          .join('; ') + '.'),
      element('p', {}, 'Errors are of the models as stored, over all values. Encode time is without reading ' +
          'options, measuring and writing. Images/s and texels/s are decoded in bulk on the device; ' +
          'look-ups/s are random texels, in the order in which they come. Peak memory is what the encoding ' +
          'process held, with the OpenCL driver’s and mapped pages of the input.'),
      element('p', {}, 'Coloured lines join what no other point of the codec beats in one figure without ' +
          'losing in the other; faint points are beaten. The sphere is lit by a key light and a soft studio.'));
}

function setTheme(dark) {
  document.documentElement.dataset.theme = dark ? 'dark' : 'light';
  byId('theme').textContent = dark ? 'Light' : 'Dark';
}

byId('text').addEventListener('input', () => {
  state.text = byId('text').value;
  draw();
});
byId('reset').addEventListener('click', () => {
  Object.assign(state, {material: '', hidden: new Set(), text: '', ranges: {}});
  byId('material').value = '';
  byId('text').value = '';
  for (const button of document.querySelectorAll('#codecs button')) {
    button.setAttribute('aria-pressed', 'true');
  }
  for (const input of document.querySelectorAll('#ranges input')) input.value = '';
  draw();
});
byId('theme').addEventListener('click', () => {
  setTheme(document.documentElement.dataset.theme !== 'dark');
});
setTheme(matchMedia('(prefers-color-scheme: dark)').matches);
fillAxes();
fillMaterials();
fillCodecs();
fillRanges();
fillTexts();
draw();
// A point to begin with: on the front of all, in its middle.
const first = paretoFront(data.points.filter((p) => p.status === 0 &&
                                                    p.material === data.materials[0]?.name),
                          'file_size', 'psnr');
choose(first[Math.floor(first.length / 2)]?.key ?? null);
let width = 0;
new ResizeObserver(() => {
  if (byId('plots').clientWidth === width) return;
  width = byId('plots').clientWidth;
  drawPlots(data.points.filter(passes));
}).observe(byId('plots'));
