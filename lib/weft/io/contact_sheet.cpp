#include "weft/io/contact_sheet.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>

#include "weft/btf/encoding.hpp"
#include "weft/error.hpp"
#include "weft/io/image.hpp"

namespace weft {
namespace {

// A PNG past this size helps nobody, and its buffer stays small.
constexpr std::size_t largest_side = 32768;

// Linear light of one image, [Y][X][shown channels].
std::vector<float> linear_image(TileSource& source, std::size_t image, std::size_t shown) {
  const BtfInfo& info = source.info();
  std::vector<std::byte> stored(info.image_bytes());
  source.read(image, 1, stored);
  source.release(image, 1);
  std::vector<float> linear(info.shape.image_values());
  convert_values({info.dtype, info.encoding}, stored, {DType::f32, Encoding::linear},
                 std::as_writable_bytes(std::span(linear)), "contact sheet");
  // Keep the channels that are shown.
  const std::size_t channels = info.shape.channels;
  for (std::size_t p = 0; p < info.shape.texels(); ++p) {
    for (std::size_t c = 0; c < shown; ++c) linear[p * shown + c] = linear[p * channels + c];
  }
  linear.resize(info.shape.texels() * shown);
  return linear;
}

double chosen_exposure(const std::vector<std::vector<float>>& images) {
  std::vector<float> values;
  for (const std::vector<float>& image : images) {
    std::copy_if(image.begin(), image.end(), std::back_inserter(values),
                 [](float value) { return std::isfinite(value); });
  }
  if (values.empty()) return 1.0;
  const auto rank = static_cast<std::ptrdiff_t>(0.99 * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + rank, values.end());
  const double percentile = static_cast<double>(values[static_cast<std::size_t>(rank)]);
  return percentile > 0 ? 1.0 / percentile : 1.0;
}

// Linear light as shown: exposed, sRGB encoded, clipped; NaN is black.
double display_value(float linear, double exposure) {
  const double shown = encode_from_linear(Encoding::srgb, static_cast<double>(linear) * exposure);
  return std::isnan(shown) ? 0.0 : std::clamp(shown, 0.0, 1.0);
}

// The sheet under construction: white, with a grid of cells of one image's size.
class Canvas {
 public:
  Canvas(std::size_t columns, std::size_t rows, const BtfShape& shape, std::size_t channels,
         std::size_t spacing)
      : cell_width_(shape.width + spacing),
        cell_height_(shape.height + spacing),
        spacing_(spacing),
        image_width_(shape.width) {
    if (cell_width_ > (largest_side - spacing) / columns ||
        cell_height_ > (largest_side - spacing) / rows) {
      fail_input(
          "a contact sheet of {} x {} images of {} x {} texels would be larger than {} pixels",
          columns, rows, shape.width, shape.height, largest_side);
    }
    info_.width = columns * cell_width_ + spacing;
    info_.height = rows * cell_height_ + spacing;
    info_.channels = channels;
    info_.dtype = DType::u8;
    pixels_.assign(info_.bytes(), std::byte{255});
  }

  // Puts display values [Y][X][channels] into a cell.
  void put(std::size_t column, std::size_t row, std::span<const double> values) {
    const std::size_t line = image_width_ * info_.channels;
    for (std::size_t y = 0; y < values.size() / line; ++y) {
      const std::size_t pixel =
          (spacing_ + row * cell_height_ + y) * info_.width + spacing_ + column * cell_width_;
      for (std::size_t i = 0; i < line; ++i) {
        pixels_[pixel * info_.channels + i] = std::byte{nearest_byte(values[y * line + i])};
      }
    }
  }

  const ImageInfo& info() const { return info_; }
  std::span<const std::byte> pixels() const { return pixels_; }

 private:
  std::size_t cell_width_;
  std::size_t cell_height_;
  std::size_t spacing_;
  std::size_t image_width_;
  ImageInfo info_;
  std::vector<std::byte> pixels_;
};

void check(const BtfInfo& original, const TileSource* decoded, const ContactSheetOptions& options) {
  if (options.images.empty()) fail_input("a contact sheet needs at least one image");
  for (const std::size_t image : options.images) {
    if (image >= original.shape.images()) {
      fail_input("contact sheet: there is no image {} among {}", image, original.shape.images());
    }
  }
  if (!std::isfinite(options.difference_scale) || options.difference_scale <= 0) {
    fail_input("contact sheet: the difference can't be enlarged by {}", options.difference_scale);
  }
  if (!std::isfinite(options.exposure) || options.exposure < 0) {
    fail_input("contact sheet: {} is no exposure", options.exposure);
  }
  if (options.spacing > 1024) fail_input("contact sheet: spacing {} exceeds 1024", options.spacing);
  if (decoded && !(decoded->info().shape == original.shape)) {
    const BtfShape& a = original.shape;
    const BtfShape& b = decoded->info().shape;
    fail_input(
        "contact sheet: the shapes differ, V {} L {} Y {} X {} C {} against V {} L {} Y {} X {} C "
        "{}",
        a.views, a.lights, a.height, a.width, a.channels, b.views, b.lights, b.height, b.width,
        b.channels);
  }
}

}  // namespace

std::vector<std::size_t> spread_images(const BtfShape& shape, std::size_t count) {
  count = std::min(count, shape.images());
  std::vector<std::size_t> images;
  for (std::size_t k = 0; k < count; ++k) {
    // Views in even steps; lights by the golden ratio, so that neighbours differ in both.
    const double step = (static_cast<double>(k) + 0.5) / static_cast<double>(count);
    const double golden = (static_cast<double>(k) + 0.5) / std::numbers::phi;
    const auto view = static_cast<std::size_t>(step * static_cast<double>(shape.views));
    const auto light =
        static_cast<std::size_t>((golden - std::floor(golden)) * static_cast<double>(shape.lights));
    std::size_t image = view * shape.lights + light;
    // Every image once: the next one that is free.
    while (std::find(images.begin(), images.end(), image) != images.end()) {
      image = (image + 1) % shape.images();
    }
    images.push_back(image);
  }
  return images;
}

ContactSheet write_contact_sheet(const std::filesystem::path& path, TileSource& original,
                                 TileSource* decoded, const ContactSheetOptions& options) {
  const BtfInfo& info = original.info();
  check(info, decoded, options);
  const std::size_t count = options.images.size();
  const std::size_t columns = options.per_row == 0 ? count : std::min(options.per_row, count);
  const std::size_t lines = (count + columns - 1) / columns;
  const std::size_t rows_of_line = decoded ? 3 : 1;
  const std::size_t channels = info.shape.channels >= 3 ? 3 : 1;
  Canvas canvas(columns, lines * rows_of_line, info.shape, channels, options.spacing);

  std::vector<std::vector<float>> originals;
  for (const std::size_t image : options.images) {
    check_interrupt();
    originals.push_back(linear_image(original, image, channels));
  }
  double exposure = options.exposure;
  if (exposure == 0) exposure = info.dtype == DType::u8 ? 1.0 : chosen_exposure(originals);

  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t column = k % columns, row = k / columns * rows_of_line;
    std::vector<double> shown;
    for (const float value : originals[k]) shown.push_back(display_value(value, exposure));
    canvas.put(column, row, shown);
    if (!decoded) continue;
    const std::vector<float> other = linear_image(*decoded, options.images[k], channels);
    std::vector<double> shown_decoded;
    for (const float value : other) shown_decoded.push_back(display_value(value, exposure));
    canvas.put(column, row + 1, shown_decoded);
    for (std::size_t i = 0; i < shown.size(); ++i) {
      shown[i] = options.difference_scale * std::abs(shown[i] - shown_decoded[i]);
    }
    canvas.put(column, row + 2, shown);
  }
  write_png(path, canvas.info(), canvas.pixels());
  return {canvas.info().width, canvas.info().height, exposure};
}

}  // namespace weft
