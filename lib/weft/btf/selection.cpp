#include "weft/btf/selection.hpp"

#include <algorithm>
#include <cstring>
#include <numeric>
#include <utility>

#include "weft/btf/mip.hpp"
#include "weft/error.hpp"

namespace weft {
namespace {

// Throws unless the list is within the limit, without repetition and not empty.
void check_list(const std::vector<std::size_t>& list, std::size_t limit, std::string_view option) {
  if (list.empty()) fail_input("{}: nothing is selected", option);
  std::vector<bool> seen(limit, false);
  for (const std::size_t index : list) {
    if (index >= limit) {
      fail_input("{}: {} is out of range: there are {}, counted from 0", option, index, limit);
    }
    if (seen[index]) fail_input("{}: {} is repeated", option, index);
    seen[index] = true;
  }
}

std::vector<std::size_t> list_or_all(const std::optional<std::vector<std::size_t>>& list,
                                     std::size_t count) {
  if (list) return *list;
  std::vector<std::size_t> all(count);
  std::iota(all.begin(), all.end(), std::size_t{0});
  return all;
}

template <typename T>
std::vector<T> gathered(const std::vector<T>& values, const std::vector<std::size_t>& indices) {
  std::vector<T> result;
  if (values.empty()) return result;
  result.reserve(indices.size());
  for (const std::size_t index : indices) result.push_back(values[index]);
  return result;
}

Region whole(const BtfShape& shape) {
  return {0, 0, shape.width, shape.height};
}

// Copies the region's channels of [Y][X][C] to [height][width][channels].
void crop(std::span<const std::byte> image, const BtfShape& shape, const Region& region,
          const std::vector<std::size_t>& channels, std::size_t value_bytes,
          std::span<std::byte> out) {
  const bool all_channels =
      channels.size() == shape.channels && std::is_sorted(channels.begin(), channels.end());
  std::byte* to = out.data();
  for (std::size_t y = 0; y < region.height; ++y) {
    const std::byte* row =
        image.data() + ((region.y + y) * shape.width + region.x) * shape.channels * value_bytes;
    if (all_channels) {
      const std::size_t bytes = region.width * shape.channels * value_bytes;
      std::memcpy(to, row, bytes);
      to += bytes;
      continue;
    }
    for (std::size_t x = 0; x < region.width; ++x) {
      for (const std::size_t channel : channels) {
        std::memcpy(to, row + (x * shape.channels + channel) * value_bytes, value_bytes);
        to += value_bytes;
      }
    }
  }
}

// The selected views' masks, cropped and reduced: 1 where at least half of the texels meet
// material.
std::vector<std::uint8_t> select_mask(const BtfInfo& info, const std::vector<std::size_t>& views,
                                      const Region& region, std::size_t level) {
  std::vector<std::uint8_t> result;
  if (info.mask.empty()) return result;
  BtfShape grey = info.shape;
  grey.channels = 1;
  std::vector<std::uint8_t> cropped(region.width * region.height);
  std::vector<float> coverage;
  for (const std::size_t view : views) {
    const auto mask = std::span(info.mask).subspan(view * grey.texels(), grey.texels());
    crop(std::as_bytes(mask), grey, region, {0}, 1, std::as_writable_bytes(std::span(cropped)));
    coverage.assign(cropped.begin(), cropped.end());
    coverage.resize(average_mip(coverage, region.height, region.width, 1, level));
    for (const float share : coverage) result.push_back(share >= 0.5f ? 1 : 0);
  }
  return result;
}

// The selected views' distances, cropped and reduced to their means.
std::vector<float> select_mask_distance(const BtfInfo& info, const std::vector<std::size_t>& views,
                                        const Region& region, std::size_t level) {
  std::vector<float> result;
  if (info.mask_distance.empty()) return result;
  BtfShape grey = info.shape;
  grey.channels = 1;
  std::vector<float> distances;
  for (const std::size_t view : views) {
    const auto whole = std::span(info.mask_distance).subspan(view * grey.texels(), grey.texels());
    distances.resize(region.width * region.height);
    crop(std::as_bytes(whole), grey, region, {0}, sizeof(float),
         std::as_writable_bytes(std::span(distances)));
    distances.resize(average_mip(distances, region.height, region.width, 1, level));
    result.insert(result.end(), distances.begin(), distances.end());
  }
  return result;
}

// See selection.hpp: reads the selected part of another source.
class SelectedSource : public TileSource {
 public:
  SelectedSource(std::shared_ptr<TileSource> source, const Selection& selection)
      : source_(std::move(source)),
        info_(select(source_->info(), selection)),
        region_(selection.region.value_or(whole(source_->info().shape))),
        level_(selection.level) {
    const BtfShape& shape = source_->info().shape;
    views_ = list_or_all(selection.views, shape.views);
    lights_ = list_or_all(selection.lights, shape.lights);
    channels_ = list_or_all(selection.channels, shape.channels);
    whole_images_ = level_ == 0 && region_ == whole(shape) && channels_.size() == shape.channels &&
                    std::is_sorted(channels_.begin(), channels_.end());
  }

  const BtfInfo& info() const override { return info_; }

  void read(std::size_t first, std::size_t count, std::span<std::byte> out) override {
    const std::size_t bytes = info_.image_bytes();
    if (first > info_.shape.images() || count > info_.shape.images() - first ||
        out.size() != count * bytes) {
      fail_runtime("selection: images {} to {} can't be read into {} bytes", first, first + count,
                   out.size());
    }
    for_runs(first, count, [&](std::size_t begin, std::size_t length, std::size_t source_begin) {
      const auto to = out.subspan((begin - first) * bytes, length * bytes);
      if (whole_images_) {
        source_->read(source_begin, length, to);
        return;
      }
      for (std::size_t i = 0; i < length; ++i) {
        read_region(source_begin + i, to.subspan(i * bytes, bytes));
      }
    });
  }

  bool read_part(std::size_t image, std::size_t first, std::size_t count,
                 std::span<std::byte> out) override {
    const std::size_t from = source_image(image);
    if (whole_images_) return source_->read_part(from, first, count, out);
    const std::span<const std::byte> values = source_->mapped(from, 1);
    if (values.empty()) return false;
    // row by row: what the texels of a row are averages of
    const std::size_t width = info_.shape.width;
    const std::size_t texel = out.size() / std::max<std::size_t>(count, 1);
    for (std::size_t p = first; p < first + count;) {
      const std::size_t run = std::min(width - p % width, first + count - p);
      const std::size_t side = std::size_t{1} << level_;
      const std::size_t x = p % width * side;
      const std::size_t y = p / width * side;
      const Region block{region_.x + x, region_.y + y, std::min(run * side, region_.width - x),
                         std::min(side, region_.height - y)};
      reduce(values, block, out.subspan((p - first) * texel, run * texel));
      p += run;
    }
    return true;
  }

  std::span<const std::byte> mapped(std::size_t first, std::size_t count) override {
    if (!whole_images_ || count == 0) return {};
    const std::size_t source_first = source_image(first);
    if (source_image(first + count - 1) != source_first + count - 1) return {};
    for (std::size_t i = 1; i < count; ++i) {
      if (source_image(first + i) != source_first + i) return {};
    }
    return source_->mapped(source_first, count);
  }

  void prefetch(std::size_t first, std::size_t count) override {
    // of a part of each image, all would be read
    if (!whole_images_) return;
    for_runs(first, count, [&](std::size_t, std::size_t length, std::size_t source_begin) {
      source_->prefetch(source_begin, length);
    });
  }

  void release(std::size_t first, std::size_t count) override {
    for_runs(first, count, [&](std::size_t, std::size_t length, std::size_t source_begin) {
      source_->release(source_begin, length);
    });
  }

 private:
  std::size_t source_image(std::size_t image) const {
    return views_[image / lights_.size()] * source_->info().shape.lights +
           lights_[image % lights_.size()];
  }

  // Calls visit(first, length, first in the source) for every run of images that follow each other
  // in the source as they do here.
  template <typename Visit>
  void for_runs(std::size_t first, std::size_t count, Visit visit) const {
    for (std::size_t begin = first; begin < first + count;) {
      const std::size_t source_begin = source_image(begin);
      std::size_t length = 1;
      while (begin + length < first + count &&
             source_image(begin + length) == source_begin + length) {
        ++length;
      }
      visit(begin, length, source_begin);
      begin += length;
    }
  }

  // One image: cropped, then reduced.
  void read_region(std::size_t image, std::span<std::byte> out) {
    const BtfInfo& whole_info = source_->info();
    std::span<const std::byte> values = source_->mapped(image, 1);
    if (values.empty()) {
      scratch_.resize(whole_info.image_bytes());
      source_->read(image, 1, scratch_);
      values = scratch_;
    }
    reduce(values, region_, out);
  }

  // A region of an image, or a part of it that begins and ends with texels of the level.
  void reduce(std::span<const std::byte> image, const Region& region, std::span<std::byte> out) {
    const BtfShape& whole_shape = source_->info().shape;
    const std::size_t value_bytes = size_of(info_.dtype);
    if (level_ == 0) {
      crop(image, whole_shape, region, channels_, value_bytes, out);
      return;
    }
    cropped_.resize(region.width * region.height * channels_.size() * value_bytes);
    crop(image, whole_shape, region, channels_, value_bytes, cropped_);
    reduce_to_mip({info_.dtype, info_.encoding}, region.height, region.width, channels_.size(),
                  level_, cropped_, out, info_.source);
  }

  std::shared_ptr<TileSource> source_;
  BtfInfo info_;
  Region region_;
  std::size_t level_;
  std::vector<std::size_t> views_;
  std::vector<std::size_t> lights_;
  std::vector<std::size_t> channels_;
  bool whole_images_ = false;
  std::vector<std::byte> scratch_;
  std::vector<std::byte> cropped_;
};

}  // namespace

std::string to_json(const Selection& selection) {
  std::string text;
  const auto add = [&](std::string_view name, const std::string& value) {
    text += fmt::format("{}\"{}\":{}", text.empty() ? "" : ",", name, value);
  };
  const auto list = [](const std::vector<std::size_t>& values) {
    std::string items;
    for (const std::size_t value : values) {
      items += fmt::format("{}{}", items.empty() ? "" : ",", value);
    }
    return "[" + items + "]";
  };
  if (selection.views) add("views", list(*selection.views));
  if (selection.lights) add("lights", list(*selection.lights));
  if (selection.region) {
    const Region& region = *selection.region;
    add("region", fmt::format("{{\"x\":{},\"y\":{},\"width\":{},\"height\":{}}}", region.x,
                              region.y, region.width, region.height));
  }
  if (selection.channels) add("channels", list(*selection.channels));
  if (selection.level != 0) add("level", fmt::format("{}", selection.level));
  return "{" + text + "}";
}

BtfInfo select(const BtfInfo& info, const Selection& selection) {
  const BtfShape& shape = info.shape;
  // Check what is asked for.
  if (selection.views) check_list(*selection.views, shape.views, "view selection");
  if (selection.lights) {
    if (info.layout == Layout::paired) {
      fail_input("light selection: a paired BTF has no lights of its own; select views (pairs)");
    }
    check_list(*selection.lights, shape.lights, "light selection");
  }
  if (selection.channels) check_list(*selection.channels, shape.channels, "channel selection");
  const Region region = selection.region.value_or(whole(shape));
  if (region.width == 0 || region.height == 0 || region.x >= shape.width ||
      region.y >= shape.height || region.width > shape.width - region.x ||
      region.height > shape.height - region.y) {
    fail_input("region {},{},{}x{} does not lie within {} x {} texels", region.x, region.y,
               region.width, region.height, shape.width, shape.height);
  }
  const std::size_t last_level = last_mip_level(region.height, region.width);
  if (selection.level > last_level) {
    fail_input("mip level {}: the last one of {} x {} texels is {}", selection.level, region.width,
               region.height, last_level);
  }
  // Gather what is selected.
  const std::vector<std::size_t> views = list_or_all(selection.views, shape.views);
  const std::vector<std::size_t> lights = list_or_all(selection.lights, shape.lights);
  const std::vector<std::size_t> channels = list_or_all(selection.channels, shape.channels);
  BtfInfo result = info;
  result.shape = {views.size(), lights.size(), mip_side(region.height, selection.level),
                  mip_side(region.width, selection.level), channels.size()};
  result.view_directions = gathered(info.view_directions, views);
  result.light_directions =
      gathered(info.light_directions, info.layout == Layout::paired ? views : lights);
  result.channel_names = gathered(info.channel_names, channels);
  result.mask = select_mask(info, views, region, selection.level);
  result.mask_distance = select_mask_distance(info, views, region, selection.level);
  return result;
}

std::shared_ptr<TileSource> select(std::shared_ptr<TileSource> source, const Selection& selection) {
  if (selection.selects_all()) return source;
  return std::make_shared<SelectedSource>(std::move(source), selection);
}

}  // namespace weft
