// What a BTF is: a tensor T[v, l, y, x, c] with its directions, and how its values are to be read.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "weft/btf/directions.hpp"
#include "weft/tensor/dtype.hpp"

namespace weft {

// Sizes V L Y X C of a BTF tensor; all are at least 1.
struct BtfShape {
  std::size_t views = 0;
  std::size_t lights = 0;
  std::size_t height = 0;
  std::size_t width = 0;
  std::size_t channels = 0;

  // N = V L.
  std::size_t images() const { return views * lights; }
  // P = Y X.
  std::size_t texels() const { return height * width; }
  // Values of one image, P C.
  std::size_t image_values() const { return texels() * channels; }
  // V L Y X C.
  std::size_t values() const { return images() * image_values(); }

  bool operator==(const BtfShape&) const = default;
};

// How a stored value relates to linear light.
enum class Encoding : std::uint8_t { linear, srgb, gamma22 };
// What a linear value is: outgoing radiance (cosine and shadows in it), or a BRDF value.
enum class Quantity : std::uint8_t { radiance, brdf };
// grid: every view with every light. paired: N view-light pairs stored as [N, 1, Y, X, C].
enum class Layout : std::uint8_t { grid, paired };

// "linear" "srgb" "gamma2.2"; "radiance" "brdf"; "grid" "paired".
std::string_view name_of(Encoding value);
std::string_view name_of(Quantity value);
std::string_view name_of(Layout value);
// The inverse; throw an input error that names `where` (file and field) and the value.
Encoding encoding_from_name(std::string_view name, std::string_view where);
Quantity quantity_from_name(std::string_view name, std::string_view where);
Layout layout_from_name(std::string_view name, std::string_view where);

// Everything about a raw BTF but its values.
struct BtfInfo {
  BtfShape shape;
  DType dtype = DType::f32;  // U8, F16 or F32
  Encoding encoding = Encoding::linear;
  Quantity quantity = Quantity::radiance;
  Layout layout = Layout::grid;
  std::vector<Direction> view_directions;   // V
  std::vector<Direction> light_directions;  // L; V where the layout is `paired`
  std::vector<std::string> channel_names;   // C, or empty
  std::string source;                       // free text: where the data came from
  std::vector<std::uint8_t> mask;           // (V, Y, X), 1 where the view meets material; or empty
  // (V, Y, X), the signed distance to the material's outline on one scale for all views, in [-1, 1]
  // and positive where the view meets material; or empty. Models do not keep it.
  std::vector<float> mask_distance;

  std::size_t bytes() const { return shape.values() * size_of(dtype); }
  std::size_t image_bytes() const { return shape.image_values() * size_of(dtype); }
};

// Throws an input error that names `where` (the file), the field and the value unless: every size
// is at least 1, their product at most 2^48 and the channels at most 1024; dtype is U8, F16 or F32;
// direction counts match the shape and layout; every direction is finite and of unit length within
// 1e-3; `paired` has L = 1; channel names, mask and mask distance, where given, have the right
// count, and these last two the right range.
void validate(const BtfInfo& info, std::string_view where);

}  // namespace weft
