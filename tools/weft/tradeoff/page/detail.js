// The chosen point: its figures, the command that makes it, and its pictures.

const shownFigures = ['file_size', 'encode_time', 'ratio', 'image_rate', 'psnr', 'texel_rate', 'snr',
                      'lookup_rate', 'ssim', 'peak_memory', 'rmse', 'relative', 'max_error',
                      'weighted_psnr', 'weighted_snr', 'log_rmse', 'log_snr'];
const degrees = ([theta, phi]) => `${Math.round(theta)}°, ${Math.round(phi)}°`;

function figureList(point) {
  const list = element('dl');
  for (const id of shownFigures) {
    if (!(id in point.figures)) continue;
    list.append(element('div', {}, element('dt', {}, figureOf[id].label),
                        element('dd', {'data-figure': id, 'data-value': point.figures[id],
                                       title: String(point.figures[id])}, textOf(point, id))));
  }
  return list;
}

function commandBox(point) {
  const text = element('pre', {id: 'command'}, point.command);
  const button = element('button', {type: 'button'}, 'Copy');
  button.addEventListener('click', async () => {
    try {
      await navigator.clipboard.writeText(point.command);
      button.textContent = 'Copied';
    } catch {
      getSelection().selectAllChildren(text);
      button.textContent = 'Selected';
    }
    setTimeout(() => { button.textContent = 'Copy'; }, 1500);
  });
  return element('div', {class: 'command'}, text, button);
}

// |a - b| of shown values, times a factor, as an image.
async function drawDifference(target, a, b, factor) {
  await Promise.all([a.decode(), b.decode()]);
  const width = Math.min(a.naturalWidth, b.naturalWidth);
  const height = Math.min(a.naturalHeight, b.naturalHeight);
  const canvas = element('canvas');
  canvas.width = width;
  canvas.height = height;
  const context = canvas.getContext('2d', {willReadFrequently: true});
  const pixelsOf = (image) => {
    context.drawImage(image, 0, 0);
    return context.getImageData(0, 0, width, height);
  };
  const result = pixelsOf(a);
  const other = pixelsOf(b);
  for (let i = 0; i < result.data.length; ++i) {
    if (i % 4 !== 3) result.data[i] = Math.min(255, factor * Math.abs(result.data[i] - other.data[i]));
  }
  context.putImageData(result, 0, 0);
  target.src = canvas.toDataURL();
}

function picture(source, id, alt) {
  const image = element('img', {id, alt});
  if (source) image.src = source;
  return image;
}

function factorChoice(redraw) {
  const choice = element('select', {id: 'factor', 'aria-label': 'Factor on differences'});
  for (const factor of [1, 4, 16]) choice.append(element('option', {value: factor}, `× ${factor}`));
  choice.value = String(factorChoice.value ?? 4);
  choice.addEventListener('change', () => {
    factorChoice.value = Number(choice.value);
    redraw(factorChoice.value);
  });
  return choice;
}

function pictureParts(point, material) {
  const redraws = [];
  const redraw = (factor) => redraws.forEach((draw) => draw(factor));
  const parts = [element('div', {class: 'picture-head'}, element('h3', {}, 'Pictures'),
                         element('label', {}, 'difference ', factorChoice(redraw)))];
  // a model of a part has images of its own
  const images = point.images ?? material.images;
  const originalStrip = point.images ? point.original : material.strip;
  if (point.strip && originalStrip) {
    const original = picture(originalStrip, 'original', 'Original images');
    const decoded = picture(point.strip, 'decoded', 'Decoded images');
    const difference = picture('', 'difference', 'Differences');
    redraws.push((factor) => drawDifference(difference, original, decoded, factor));
    const labels = images.map((image) => element('span', {
      title: `view ${image.view} at theta ${degrees(image.view_direction)}; light ${image.light} ` +
             `at theta ${degrees(image.light_direction)} (theta, phi)`,
    }, `v ${degrees(image.view_direction)}`, element('br'),
       `l ${degrees(image.light_direction)}`));
    parts.push(element('div', {class: 'pictures'}, 'original', original, 'decoded', decoded,
                       'difference', difference, 'theta, phi',
                       element('div', {class: 'tiles'}, ...labels)));
  }
  if (point.sphere && material.sphere) {
    const original = picture(material.sphere, 'sphere-original', 'Sphere of the original');
    const decoded = picture(point.sphere, 'sphere', 'Sphere of the model');
    const difference = picture('', 'sphere-difference', 'Difference of the spheres');
    redraws.push((factor) => drawDifference(difference, original, decoded, factor));
    parts.push(element('h3', {}, 'On a sphere'),
               element('div', {class: 'spheres'},
                       ...[['original', original], ['decoded', decoded], ['difference', difference]]
                           .map(([name, image]) => element('figure', {}, image,
                                                           element('figcaption', {}, name)))));
  }
  if (parts.length === 1) {
    const why = point.left_out ? 'The pictures of this point are in the folder images beside this page; '
                                 + 'here they would take too much room.'
                               : 'There are no pictures of this point.';
    return [element('p', {class: 'note'}, why)];
  }
  redraw(factorChoice.value ?? 4);
  return parts;
}

function drawDetail(target, point, material, index) {
  if (!point) {
    target.replaceChildren(element('p', {class: 'note'}, 'Choose a point in a plot or in the table.'));
    return;
  }
  const title = element('h2', {}, `${point.codec} ${point.optionText}`);
  const parts = [element('p', {class: 'who'}, point.material), title];
  if (point.status === 0) parts.push(figureList(point));
  if (point.message) parts.push(element('p', {class: 'message'}, point.message));
  parts.push(element('h3', {}, 'Command'), commandBox(point));
  if (point.status === 0) parts.push(...pictureParts(point, material));
  if (point.notes) {
    parts.push(element('details', {}, element('summary', {}, 'How it was made'),
                       element('p', {class: 'note'}, point.notes)));
  }
  target.dataset.key = point.key;
  target.style.borderTop = `4px solid ${colour(index)}`;
  target.replaceChildren(...parts);
  target.scrollTop = 0;
}
