// Plots: a panel per material, two figures against each other, and the Pareto fronts.

const margin = {left: 64, right: 16, top: 12, bottom: 46};

// Round values between two numbers, about `count` of them.
function ticksOf(low, high, log, count) {
  const ticks = [];
  if (log) {
    const decades = Math.log10(high / low);
    const steps = decades > 3 ? [1] : decades > 1.2 ? [1, 2, 5] : [1, 1.5, 2, 3, 4, 5, 6, 8];
    for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high); ++power) {
      for (const step of steps) {
        const value = step * 10 ** power;
        if (value >= low * 0.999 && value <= high * 1.001) ticks.push(value);
      }
    }
    const every = Math.ceil(ticks.length / count);
    return ticks.filter((_, i) => i % every === 0);
  }
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough);
  for (let value = Math.ceil(low / step) * step; value <= high + step * 1e-6; value += step) {
    ticks.push(value);
  }
  return ticks;
}

// Bytes have round values of their own.
function byteTicks(low, high, count) {
  const ticks = [];
  const steps = high / low > 6 ? [1] : high / low > 2 ? [1, 1.5] : [1, 1.125, 1.25, 1.5, 1.75];
  for (let value = 2 ** Math.floor(Math.log2(low)); value <= high; value *= 2) {
    ticks.push(...steps.map((step) => step * value).filter((tick) => tick >= low && tick <= high));
  }
  const every = Math.ceil(ticks.length / count);
  return ticks.filter((_, i) => i % every === 0);
}

function tickText(figure, value) {
  if (figure.text === decibels) return `${Number(value.toPrecision(4))}`;
  if (figure.text === bytesText) return bytesText(value).replace(/(\.\d*?)0+ /, '$1 ').replace('. ', ' ');
  if (figure.text === secondsText) return value < 1 ? `${Number((value * 1000).toPrecision(3))} ms`
                                                    : `${Number(value.toPrecision(3))} s`;
  if (figure.text === scaledText) {
    for (const [factor, letter] of [[1e9, 'G'], [1e6, 'M'], [1e3, 'k']]) {
      if (value >= factor) return `${Number((value / factor).toPrecision(3))} ${letter}`;
    }
  }
  return `${Number(value.toPrecision(3))}`;
}

// An axis: from values to pixels, with its ticks.
function makeAxis(figure, log, values, length, count) {
  let low = Math.min(...values);
  let high = Math.max(...values);
  const place = log ? Math.log : (value) => value;
  const back = log ? Math.exp : (value) => value;
  const space = (place(high) - place(low)) * 0.06 || (log ? 0.3 : Math.abs(high) * 0.1 || 1);
  low = back(place(low) - space);
  high = back(place(high) + space);
  const scale = length / (place(high) - place(low));
  const bytes = log && figure.text === bytesText;
  return {
    at: (value) => (place(value) - place(low)) * scale,
    ticks: bytes ? byteTicks(low, high, count) : ticksOf(low, high, log, count),
  };
}

// Whether a point has both figures, in a range that the axes can show.
function canPlot(point, x, y) {
  const shown = (value, log) => Number.isFinite(value) && (!log || value > 0);
  return point.status === 0 && shown(valueOf(point, x.figure.id), x.log) &&
         shown(valueOf(point, y.figure.id), y.log);
}

function axisParts(x, y, width, height) {
  const grid = drawn('g', {class: 'grid'});
  const axis = drawn('g', {class: 'axis'});
  for (const value of x.axis.ticks) {
    const at = x.axis.at(value);
    grid.append(drawn('line', {x1: at, x2: at, y1: 0, y2: height}));
    axis.append(drawn('text', {x: at, y: height + 18, 'text-anchor': 'middle'},
                      tickText(x.figure, value)));
  }
  for (const value of y.axis.ticks) {
    const at = height - y.axis.at(value);
    grid.append(drawn('line', {x1: 0, x2: width, y1: at, y2: at}));
    axis.append(drawn('text', {x: -8, y: at + 4, 'text-anchor': 'end'},
                      tickText(y.figure, value)));
  }
  const title = (figure) => `${figure.label}${figure.text === decibels ? ', dB' : ''} ` +
                            (figure.better > 0 ? '(more is better)' : '(less is better)');
  axis.append(drawn('text', {class: 'title', x: width / 2, y: height + 38,
                             'text-anchor': 'middle'}, title(x.figure)));
  axis.append(drawn('text', {class: 'title', 'text-anchor': 'middle',
                             transform: `translate(-50,${height / 2}) rotate(-90)`},
                    title(y.figure)));
  return [grid, axis];
}

// One panel. `choose` is called with the key of a point; marks are reached by one tab stop and arrows.
function makePanel(material, points, x, y, codecs, chosen, choose) {
  const panel = element('div', {class: 'panel', 'data-material': material.name});
  panel.append(element('h2', {}, material.name));
  const whole = Math.max(300, panelWidth());
  const height = 330;
  const width = whole - margin.left - margin.right;
  const shown = points.filter((point) => canPlot(point, x, y));
  const svg = drawn('svg', {viewBox: `0 0 ${whole} ${height + margin.top + margin.bottom}`,
                            role: 'group',
                            'aria-label': `${y.figure.label} against ${x.figure.label}`});
  panel.append(svg);
  if (shown.length === 0) {
    svg.replaceWith(element('p', {class: 'nothing'}, 'No point to show.'));
    return panel;
  }
  const plot = drawn('g', {transform: `translate(${margin.left},${margin.top})`});
  svg.append(plot);
  const xs = {...x, axis: makeAxis(x.figure, x.log, x.values, width, Math.floor(width / 75))};
  const ys = {...y, axis: makeAxis(y.figure, y.log, y.values, height, 7)};
  const place = (point) => [xs.axis.at(valueOf(point, x.figure.id)),
                            height - ys.axis.at(valueOf(point, y.figure.id))];
  plot.append(...axisParts(xs, ys, width, height));

  const line = (front) => 'M' + front.map((point) => place(point).map((v) => v.toFixed(1)).join(','))
                                     .join('L');
  const best = paretoFront(shown, x.figure.id, y.figure.id);
  plot.append(drawn('path', {class: 'front-all', d: line(best)}));
  const onFront = new Set();
  codecs.forEach((codec, index) => {
    const own = shown.filter((point) => point.codec === codec);
    const front = paretoFront(own, x.figure.id, y.figure.id);
    front.forEach((point) => onFront.add(point.key));
    if (front.length > 1) {
      plot.append(drawn('path', {class: 'front', d: line(front), stroke: colour(index),
                                 'data-codec': codec}));
    }
  });

  // From left to right, so that arrow keys go that way; what is on a front is drawn last.
  const ordered = [...shown].sort((a, b) => place(a)[0] - place(b)[0]);
  const marks = new Map();
  for (const point of ordered) {
    const index = codecs.indexOf(point.codec);
    const [px, py] = place(point);
    const label = `${point.codec} ${point.optionText}: ${x.figure.label} ` +
                  `${textOf(point, x.figure.id)}, ${y.figure.label} ${textOf(point, y.figure.id)}`;
    const mark = drawn('g', {
      class: 'mark' + (onFront.has(point.key) ? '' : ' behind') +
             (point.key === chosen ? ' chosen' : ''),
      transform: `translate(${px.toFixed(1)},${py.toFixed(1)})`, 'data-key': point.key,
      role: 'button', tabindex: '-1', 'aria-label': label});
    mark.append(drawn('circle', {class: 'ring', r: 10}),
                drawn('path', {class: 'shape', d: shape(index), fill: colour(index)}));
    mark.addEventListener('click', () => choose(point.key));
    mark.addEventListener('pointerenter', () => showTip(mark, point, x.figure, y.figure));
    mark.addEventListener('pointerleave', hideTip);
    mark.addEventListener('focus', () => showTip(mark, point, x.figure, y.figure));
    mark.addEventListener('blur', hideTip);
    marks.set(point.key, mark);
  }
  const stop = marks.get(chosen) ?? marks.get(ordered[0].key);
  stop.setAttribute('tabindex', '0');
  const last = ordered.filter((point) => onFront.has(point.key));
  for (const point of [...ordered.filter((p) => !onFront.has(p.key)), ...last]) {
    plot.append(marks.get(point.key));
  }
  svg.addEventListener('keydown', (event) => {
    const key = event.target.getAttribute('data-key');
    const at = ordered.findIndex((point) => point.key === key);
    if (at < 0) return;
    const step = {ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1}[event.key];
    if (step) {
      const next = ordered[(at + step + ordered.length) % ordered.length];
      event.target.setAttribute('tabindex', '-1');
      marks.get(next.key).setAttribute('tabindex', '0');
      marks.get(next.key).focus();
      event.preventDefault();
    } else if (event.key === 'Enter' || event.key === ' ') {
      choose(key);
      event.preventDefault();
    }
  });
  return panel;
}

function panelWidth() {
  const plots = document.getElementById('plots');
  const columns = getComputedStyle(plots).gridTemplateColumns.split(' ');
  return (parseFloat(columns[0]) || 600) - 26;
}

function showTip(mark, point, x, y) {
  const tip = document.getElementById('tip');
  tip.replaceChildren(element('b', {}, `${point.codec} ${point.optionText}`),
                      `${x.label} ${textOf(point, x.id)}, ${y.label} ${textOf(point, y.id)}`);
  tip.hidden = false;
  const box = mark.getBoundingClientRect();
  const left = Math.min(box.left + 18, window.innerWidth - tip.offsetWidth - 8);
  const top = box.top - tip.offsetHeight - 8;
  tip.style.left = `${Math.max(8, left)}px`;
  tip.style.top = `${top < 8 ? box.bottom + 8 : top}px`;
}

function hideTip() {
  document.getElementById('tip').hidden = true;
}
