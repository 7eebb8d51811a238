#include "weft/io/image_source.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <utility>

#include "weft/error.hpp"

namespace weft {
namespace {

constexpr std::size_t pairs_named = 3;

std::string pair_name(const Direction& view, const Direction& light) {
  return fmt::format("view (theta {:.4g}, phi {:.4g}) with light (theta {:.4g}, phi {:.4g})",
                     theta_degrees(view), phi_degrees(view), theta_degrees(light),
                     phi_degrees(light));
}

std::string listed(const std::vector<std::string>& names, std::size_t count) {
  return fmt::format("{}{}", fmt::join(names, "; "), count > names.size() ? "; ..." : "");
}

}  // namespace

ImageSource::ImageSource(std::shared_ptr<ImageCollection> collection,
                         std::vector<std::size_t> files, BtfInfo info)
    : collection_(std::move(collection)), files_(std::move(files)), info_(std::move(info)) {
  if (files_.empty()) fail_input("{}: no images", collection_->path().string());
  image_ = collection_->info_of(files_.front());
  info_.dtype = image_.dtype;
  info_.shape.height = image_.height;
  info_.shape.width = image_.width;
  info_.shape.channels = image_.channels;
  validate(info_, collection_->path().string());
  if (info_.shape.images() != files_.size()) {
    fail_runtime("{}: {} files for {} images", collection_->path().string(), files_.size(),
                 info_.shape.images());
  }
}

void ImageSource::read(std::size_t first, std::size_t count, std::span<std::byte> out) {
  const std::size_t bytes = info_.image_bytes();
  if (first > files_.size() || count > files_.size() - first || out.size() != count * bytes) {
    fail_runtime("{}: images {} to {} can't be read into {} bytes", collection_->path().string(),
                 first, first + count, out.size());
  }
  for (std::size_t i = 0; i < count; ++i) {
    check_interrupt();
    const std::size_t file = files_[first + i];
    read_image(collection_->bytes(file), collection_->shown_name(file), image_,
               out.subspan(i * bytes, bytes));
  }
}

std::vector<std::size_t> arrange_grid(const ImageCollection& collection,
                                      std::vector<ViewLightFile> images,
                                      const std::vector<Direction>& views,
                                      const std::vector<Direction>& lights) {
  const auto place = [&](const ViewLightFile& image) {
    return image.view * lights.size() + image.light;
  };
  std::stable_sort(
      images.begin(), images.end(),
      [&](const ViewLightFile& a, const ViewLightFile& b) { return place(a) < place(b); });
  // Pairs that come twice.
  std::vector<std::string> names;
  std::size_t count = 0;
  for (std::size_t i = 1; i < images.size(); ++i) {
    if (place(images[i]) != place(images[i - 1])) continue;
    if (++count <= pairs_named) {
      names.push_back(fmt::format(
          "{} in {} and {}", pair_name(views[images[i].view], lights[images[i].light]),
          collection.shown_name(images[i - 1].file), collection.shown_name(images[i].file)));
    }
  }
  if (count > 0) {
    fail_input("{}: {} view-light pair{} more than once: {}", collection.path().string(), count,
               count == 1 ? " comes" : "s come", listed(names, count));
  }
  // Pairs that are missing: the gaps. The grid itself may be far larger than the list.
  const std::size_t expected = views.size() * lights.size();
  for (std::size_t i = 0, next = 0; i <= images.size() && names.size() < pairs_named; ++i) {
    const std::size_t found = i < images.size() ? place(images[i]) : expected;
    for (; next < found && names.size() < pairs_named; ++next) {
      names.push_back(pair_name(views[next / lights.size()], lights[next % lights.size()]));
    }
    next = found + 1;
  }
  if (images.size() != expected) {
    count = expected - images.size();
    fail_input("{}: {} of {} view-light pairs ({} views, {} lights) {} missing: {}",
               collection.path().string(), count, expected, views.size(), lights.size(),
               count == 1 ? "is" : "are", listed(names, count));
  }
  std::vector<std::size_t> files;
  files.reserve(images.size());
  for (const ViewLightFile& image : images) files.push_back(image.file);
  return files;
}

Encoding usual_encoding(DType dtype) {
  return dtype == DType::u8 ? Encoding::srgb : Encoding::linear;
}

bool is_mask_name(const std::string& file) {
  if (!is_image_name(file)) return false;
  const std::string stem = std::filesystem::path(file).stem().string();
  return stem == "mask" || stem.ends_with(".mask") || stem.ends_with("_mask") ||
         stem.ends_with("-mask");
}

std::vector<std::uint8_t> read_mask_image(ImageCollection& collection, std::size_t file,
                                          const ImageInfo& expected, std::size_t views) {
  const std::string name = collection.shown_name(file);
  const ImageInfo info = collection.info_of(file);
  if (info.width != expected.width || info.height != expected.height || info.dtype != DType::u8) {
    fail_input("{}: a mask of {} x {} in {} where {} x {} in U8 was expected", name, info.width,
               info.height, name_of(info.dtype), expected.width, expected.height);
  }
  std::vector<std::byte> values(info.bytes());
  read_image(collection.bytes(file), name, info, values);
  std::vector<std::uint8_t> mask;
  mask.reserve(views * info.width * info.height);
  for (std::size_t i = 0; i < values.size(); i += info.channels) {
    const std::byte* first = values.data() + i;
    const std::byte brightest = *std::max_element(first, first + info.channels);
    mask.push_back(brightest >= std::byte{128} ? 1 : 0);
  }
  const std::size_t texels = mask.size();
  for (std::size_t view = 1; view < views; ++view) {
    mask.insert(mask.end(), mask.begin(), mask.begin() + static_cast<std::ptrdiff_t>(texels));
  }
  return mask;
}

}  // namespace weft
