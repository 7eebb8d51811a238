// The table: a row per point, sorted by any column.

const shortLabels = {encode_time: 'Encode', peak_memory: 'Memory'};
const columns = [
  {id: 'material', label: 'Material'},
  {id: 'codec', label: 'Codec'},
  {id: 'options', label: 'Options'},
  ...['file_size', 'ratio', 'rmse', 'psnr', 'snr', 'ssim', 'encode_time', 'image_rate',
      'lookup_rate', 'peak_memory'].map((id) => ({id, label: shortLabels[id] ?? figureOf[id].label,
                                                  figure: true})),
];

// Texts by their numbers too: rank 8 before rank 16.
const textOrder = new Intl.Collator('en', {numeric: true});

function compare(a, b, id) {
  if (id === 'material') return textOrder.compare(a.material, b.material);
  if (id === 'codec') return textOrder.compare(a.codec, b.codec);
  if (id === 'options') return textOrder.compare(a.optionText, b.optionText);
  return valueOf(a, id) - valueOf(b, id);
}

// What has no value comes last either way.
function sortPoints(points, sort) {
  const missing = (point) => figureOf[sort.id] && Number.isNaN(valueOf(point, sort.id));
  return [...points].sort((a, b) => missing(a) - missing(b) ||
                                    (missing(a) ? 0 : sort.direction * compare(a, b, sort.id)));
}

function drawHead(head, sort, onSort) {
  const row = element('tr');
  for (const column of columns) {
    const direction = column.id !== sort.id ? 'none'
                      : sort.direction > 0 ? 'ascending' : 'descending';
    const button = element('button', {type: 'button', 'data-sort': column.id}, column.label);
    button.addEventListener('click', () => onSort(column.id));
    row.append(element('th', {scope: 'col', 'aria-sort': direction,
                              class: column.figure ? 'number' : 'text'}, button));
  }
  const focused = document.activeElement?.getAttribute('data-sort');
  head.replaceChildren(row);
  if (focused) head.querySelector(`[data-sort="${focused}"]`).focus();
}

function drawRow(point, codecs, chosen, choose) {
  const row = element('tr', {'data-key': point.key, class: point.key === chosen ? 'chosen' : ''});
  row.append(element('td', {}, point.material));
  row.append(element('td', {}, element('span', {class: 'cell'},
                                       swatch(codecs.indexOf(point.codec)), point.codec)));
  const button = element('button', {type: 'button'}, point.optionText || '(defaults)');
  row.append(element('td', {class: 'options'}, button));
  if (point.status !== 0) {
    row.append(element('td', {class: 'message', colspan: columns.length - 3},
                       `${point.status === 1 ? 'not met' : `failed, status ${point.status}`}: ` +
                       point.message));
  } else {
    for (const column of columns.filter((c) => c.figure)) {
      row.append(element('td', {class: 'number', 'data-figure': column.id},
                         textOf(point, column.id)));
    }
  }
  row.addEventListener('click', () => choose(point.key));
  return row;
}
