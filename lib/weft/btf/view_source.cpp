#include "weft/btf/view_source.hpp"

namespace weft {
namespace {

BtfInfo info_of_view(const BtfInfo& whole, std::size_t view) {
  BtfInfo info = whole;
  info.shape.views = 1;
  info.view_directions = {whole.view_directions.at(view)};
  if (whole.layout == Layout::paired) info.light_directions = {whole.light_directions.at(view)};
  if (!whole.mask.empty()) {
    const auto texels = static_cast<std::ptrdiff_t>(whole.shape.texels());
    const auto first = whole.mask.begin() + static_cast<std::ptrdiff_t>(view) * texels;
    info.mask.assign(first, first + texels);
  }
  if (!whole.mask_distance.empty()) {
    const auto texels = static_cast<std::ptrdiff_t>(whole.shape.texels());
    const auto first = whole.mask_distance.begin() + static_cast<std::ptrdiff_t>(view) * texels;
    info.mask_distance.assign(first, first + texels);
  }
  return info;
}

}  // namespace

ViewSource::ViewSource(TileSource& whole, std::size_t view)
    : whole_(whole),
      first_(view * whole.info().shape.lights),
      info_(info_of_view(whole.info(), view)) {}

void ViewSource::read(std::size_t first, std::size_t count, std::span<std::byte> out) {
  whole_.read(first_ + first, count, out);
}

std::span<const std::byte> ViewSource::mapped(std::size_t first, std::size_t count) {
  return whole_.mapped(first_ + first, count);
}

void ViewSource::prefetch(std::size_t first, std::size_t count) {
  whole_.prefetch(first_ + first, count);
}

void ViewSource::release(std::size_t first, std::size_t count) {
  whole_.release(first_ + first, count);
}

}  // namespace weft
