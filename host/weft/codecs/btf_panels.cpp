#include "weft/codecs/btf_panels.hpp"

#include <algorithm>

#include "weft/btf/texel_block.hpp"
#include "weft/codecs/scan_source.hpp"
#include "weft/device/read_ahead.hpp"
#include "weft/device/tile_stream.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/sum_squares.hpp"
#include "weft/ops/tile.hpp"

namespace weft {
namespace {

std::size_t channel_images(const BtfShape& shape) {
  return shape.images() * shape.channels;
}

Buffer mean_buffer(Device& device, std::span<const float> mean) {
  Buffer buffer(device, mean.size() * sizeof(float), "mean");
  device.write(buffer, mean);
  return buffer;
}

// A block of texels of all images, as raw values and as panels.
ops::TileShape texel_tile(const BtfInfo& info, std::size_t texels, bool nan_zero) {
  return {info.shape.images(), texels, info.shape.channels, info.dtype, nan_zero};
}
std::size_t texel_block_bytes(const BtfInfo& info) {
  return texel_granule(info.shape) * channel_images(info.shape) * size_of(info.dtype);
}

class ImagePanels final : public PanelStream {
 public:
  ImagePanels(Device& device, TileSource& source, Arithmetic arithmetic,
              std::span<const float> mean, float scale, const Job& job)
      : PanelStream(channel_images(source.info().shape), source.info().shape.texels(),
                    panel_granule(source.info().shape, StreamedRows::images), arithmetic),
        device_(device),
        info_(source.info()),
        stream_(device, source, image_granule(source.info().shape)),
        mean_(mean_buffer(device, mean)),
        scale_(scale),
        job_(job) {}

  double scale() const override { return static_cast<double>(scale_); }
  double bytes() const override { return static_cast<double>(info_.bytes()); }

  void for_each(const Work& work, double* squares) override {
    const std::size_t channels = info_.shape.channels;
    Buffer panels(
        device_,
        ops::panel_elements(device_, tile_shape(info_, stream_.granule(), job_), arithmetic()) *
            size_of(arithmetic()),
        "tile");
    stream_.for_each([&](std::size_t first, std::size_t count, const Buffer& raw) {
      ops::convert_tile(device_, tile_shape(info_, count, job_), raw, mean_, first * channels,
                        scale_, panels, squares, arithmetic());
      work(panels, first * channels, count * channels);
    });
    device_.finish();
  }

 private:
  Device& device_;
  const BtfInfo& info_;
  TileStream stream_;
  Buffer mean_;
  float scale_;
  const Job& job_;
};

class TexelPanels final : public PanelStream {
 public:
  TexelPanels(Device& device, TileSource& source, Arithmetic arithmetic,
              std::span<const float> mean, float scale, const Job& job)
      : PanelStream(source.info().shape.texels(), channel_images(source.info().shape),
                    panel_granule(source.info().shape, StreamedRows::texels), arithmetic),
        device_(device),
        source_(source),
        mean_(mean_buffer(device, mean)),
        scale_(scale),
        nan_zero_(job.nan_zero) {}

  double scale() const override { return static_cast<double>(scale_); }
  double bytes() const override { return static_cast<double>(source_.info().bytes()); }

  void for_each(const Work& work, double* squares) override {
    const BtfInfo& info = source_.info();
    const std::size_t elements = ops::transposed_panel_elements(
        device_, texel_tile(info, granule(), nan_zero_), arithmetic());
    Buffer panels(device_, elements * size_of(arithmetic()), "tile");
    const auto count = [&](std::size_t run) {
      return std::min(granule(), rows() - run * granule());
    };
    for_each_run(
        device_, ops::ceil_div(rows(), granule()), texel_block_bytes(info),
        [&](std::size_t run, std::span<std::byte> slot) {
          const std::size_t bytes = count(run) * columns() * size_of(info.dtype);
          read_texels(source_, run * granule(), count(run), slot.first(bytes));
          return bytes;
        },
        [&](std::size_t run, const Buffer& raw) {
          const ops::TileShape tile = texel_tile(info, count(run), nan_zero_);
          ops::convert_tile_transposed(device_, tile, raw, mean_, 0, scale_, panels, arithmetic());
          if (squares) {
            *squares += ops::sum_squares(
                device_, ops::transposed_panel_elements(device_, tile, arithmetic()), panels,
                arithmetic());
          }
          work(panels, run * granule(), count(run));
        });
    device_.finish();
  }

 private:
  Device& device_;
  TileSource& source_;
  Buffer mean_;
  float scale_;
  bool nan_zero_;
};

}  // namespace

std::size_t panel_granule(const BtfShape& shape, StreamedRows rows) {
  return rows == StreamedRows::images ? image_granule(shape) * shape.channels
                                      : texel_granule(shape);
}

std::unique_ptr<PanelStream> btf_panels(Device& device, TileSource& source, StreamedRows rows,
                                        Arithmetic arithmetic, std::span<const float> mean,
                                        float scale, const Job& job) {
  if (rows == StreamedRows::images) {
    return std::make_unique<ImagePanels>(device, source, arithmetic, mean, scale, job);
  }
  return std::make_unique<TexelPanels>(device, source, arithmetic, mean, scale, job);
}

std::size_t btf_panels_bytes(Device& device, TileSource& source, StreamedRows rows,
                             Arithmetic arithmetic) {
  const BtfInfo& info = source.info();
  const std::size_t mean = channel_images(info.shape) * sizeof(float);
  if (rows == StreamedRows::images) {
    const std::size_t granule = image_granule(info.shape);
    const ops::TileShape tile{granule, info.shape.texels(), info.shape.channels, info.dtype, false};
    return mean + TileStream(device, source, granule).buffer_bytes() +
           ops::panel_elements(device, tile, arithmetic) * size_of(arithmetic);
  }
  const ops::TileShape tile = texel_tile(info, texel_granule(info.shape), false);
  return mean + info.image_bytes() + read_ahead_bytes(device, texel_block_bytes(info)) +
         ops::transposed_panel_elements(device, tile, arithmetic) * size_of(arithmetic);
}

}  // namespace weft
