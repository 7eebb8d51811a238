// A BTF whose images are files of a collection: what every reader of captures ends in.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "weft/btf/tile.hpp"
#include "weft/io/image_collection.hpp"

namespace weft {

// Reads images [Y][X][C] file by file; image i is file `files[i]` of the collection. At most one
// decoded image is held at a time, apart from what the caller holds.
class ImageSource final : public TileSource {
 public:
  // Sizes and dtype are those of the first image and stand in `info` afterwards; directions,
  // encoding and the rest must be there. Throws an input error if `info` is not valid with them.
  ImageSource(std::shared_ptr<ImageCollection> collection, std::vector<std::size_t> files,
              BtfInfo info);

  const BtfInfo& info() const override { return info_; }
  void read(std::size_t first, std::size_t count, std::span<std::byte> out) override;

 private:
  std::shared_ptr<ImageCollection> collection_;
  std::vector<std::size_t> files_;
  BtfInfo info_;
  ImageInfo image_;
};

// An opened capture.
struct Capture {
  std::shared_ptr<TileSource> source;
  std::string kind;                  // "ubo2003", "manifest", "lights", "flash"
  std::vector<std::string> ignored;  // images that are no part of it
};

// A file that shows one view under one light, by their indices.
struct ViewLightFile {
  std::size_t view = 0;
  std::size_t light = 0;
  std::size_t file = 0;
};

// The files in the order v L + l. Throws an input error that names the first few pairs that are
// missing or come twice, and says how many there are.
std::vector<std::size_t> arrange_grid(const ImageCollection& collection,
                                      std::vector<ViewLightFile> images,
                                      const std::vector<Direction>& views,
                                      const std::vector<Direction>& lights);

// sRGB for 8-bit images and linear light for EXR: what the file formats themselves stand for.
Encoding usual_encoding(DType dtype);

// True for images named as masks: mask.png, NAME.mask.png, NAME_mask.png, NAME-mask.png.
bool is_mask_name(const std::string& file);

// The mask that an 8-bit image of height x width stands for, the same for each of the views: 1
// where its brightest channel is at least 128.
std::vector<std::uint8_t> read_mask_image(ImageCollection& collection, std::size_t file,
                                          const ImageInfo& expected, std::size_t views);

}  // namespace weft
