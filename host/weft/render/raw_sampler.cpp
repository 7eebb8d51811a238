#include "weft/render/raw_sampler.hpp"

#include <algorithm>
#include <utility>

#include "weft/btf/mip.hpp"
#include "weft/error.hpp"
#include "weft/ops/launch.hpp"
#include "weft/ops/look_up_raw.hpp"

namespace weft {
namespace {

// The info of a mip level, without what nothing here asks for.
BtfInfo level_info(const BtfInfo& whole, std::size_t level) {
  BtfInfo info;
  info.shape = whole.shape;
  info.shape.height = mip_side(whole.shape.height, level);
  info.shape.width = mip_side(whole.shape.width, level);
  info.dtype = whole.dtype;
  info.encoding = whole.encoding;
  return info;
}

class SourceImages final : public ImageStream {
 public:
  SourceImages(Device& device, std::shared_ptr<TileSource> source)
      : source_(std::move(source)),
        stream_(device, *source_, image_granule(source_->info().shape)) {}
  const BtfInfo& info() const override { return source_->info(); }
  void for_each(const TileStream::Work& work) override { stream_.for_each(work); }
  std::size_t bytes() const override { return stream_.buffer_bytes(); }

 private:
  std::shared_ptr<TileSource> source_;
  TileStream stream_;
};

class DecodedImages final : public ImageStream {
 public:
  DecodedImages(Device& device, std::shared_ptr<const Model> model)
      : device_(device), model_(std::move(model)), info_(model_->info.btf) {
    info_.dtype = DType::f32;
  }
  const BtfInfo& info() const override { return info_; }
  void for_each(const TileStream::Work& work) override {
    const std::size_t run = image_granule(info_.shape);
    const auto decoder = find_codec(model_->info.codec).decoder(device_, *model_);
    Buffer decoded(device_, run * info_.image_bytes(), "decoded images");
    for (std::size_t first = 0; first < info_.shape.images(); first += run) {
      check_interrupt();
      const std::size_t count = std::min(run, info_.shape.images() - first);
      decoder->decode(first, count, decoded);
      work(first, count, decoded);
    }
    device_.finish();
  }
  std::size_t bytes() const override {
    return image_granule(info_.shape) * info_.image_bytes() +
           find_codec(model_->info.codec).decoder_bytes(*model_);
  }

 private:
  Device& device_;
  std::shared_ptr<const Model> model_;
  BtfInfo info_;
};

// A level in device memory: buffers of as many whole runs of images as one allocation holds.
class ResidentLevel {
 public:
  ResidentLevel(Device& device, const BtfInfo& info, std::size_t run) {
    const std::size_t fitting = device.limits().largest_allocation / info.image_bytes();
    images_ = std::max<std::size_t>(fitting / run, 1) * run;
    for (std::size_t first = 0; first < info.shape.images(); first += images_) {
      const std::size_t count = std::min(images_, info.shape.images() - first);
      chunks_.emplace_back(device, count * info.image_bytes(), "images of a mip level");
    }
  }

  std::size_t chunks() const { return chunks_.size(); }
  std::size_t first_image(std::size_t chunk) const { return chunk * images_; }
  const Buffer& chunk(std::size_t index) const { return chunks_[index]; }

  // Where image `first`, the first of a run, lies.
  Buffer& chunk_of(std::size_t first) { return chunks_[first / images_]; }
  std::size_t place(std::size_t first) const { return first % images_; }

 private:
  std::size_t images_ = 0;
  std::vector<Buffer> chunks_;
};

class ResidentSampler final : public DeviceSampler {
 public:
  ResidentSampler(Device& device, BtfInfo info, ResidentLevel level)
      : device_(device), info_(std::move(info)), level_(std::move(level)) {}

  void look_up(const LookupShape& lookup, std::size_t count, const Buffer& lookups,
               Buffer& out) override {
    validate(lookup, info_.shape);
    const BtfShape& shape = info_.shape;
    device_.fill_zero(out, 0, count * shape.channels * sizeof(float));
    for (std::size_t i = 0; i < level_.chunks(); ++i) {
      const std::size_t first = level_.first_image(i);
      ops::look_up_raw(device_, {lookup, shape, count, lookups, out}, info_.dtype, first,
                       level_.chunk(i).size() / info_.image_bytes(), level_.chunk(i));
    }
  }

  double lookup_flops(const LookupShape& lookup) const override {
    return 2.0 * static_cast<double>((lookup.texels + 1) * lookup.views * lookup.lights *
                                     info_.shape.channels);
  }

 private:
  Device& device_;
  BtfInfo info_;
  ResidentLevel level_;
};

// Goes through the images for each call, and reduces them run by run.
class StreamedSampler final : public DeviceSampler {
 public:
  StreamedSampler(Device& device, std::shared_ptr<ImageStream> images, std::size_t level)
      : device_(device), images_(std::move(images)), level_(level) {}

  void look_up(const LookupShape& lookup, std::size_t count, const Buffer& lookups,
               Buffer& out) override {
    const BtfInfo info = level_info(images_->info(), level_);
    validate(lookup, info.shape);
    device_.fill_zero(out, 0, count * info.shape.channels * sizeof(float));
    if (count == 0) return;
    const std::size_t run = image_granule(images_->info().shape);
    std::vector<Buffer> reduced;  // of the levels up to this one
    for (std::size_t level = 1; level <= level_; ++level) {
      reduced.emplace_back(device_, run * level_info(images_->info(), level).image_bytes(),
                           "reduced images");
    }
    images_->for_each([&](std::size_t first, std::size_t images, const Buffer& raw) {
      const Buffer* values = &raw;
      for (std::size_t level = 0; level < level_; ++level) {
        ops::reduce_mip(device_, level_info(images_->info(), level), images, 0, *values, 0,
                        reduced[level]);
        values = &reduced[level];
      }
      ops::look_up_raw(device_, {lookup, info.shape, count, lookups, out}, info.dtype, first,
                       images, *values);
    });
  }

  double lookup_flops(const LookupShape& lookup) const override {
    return 2.0 * static_cast<double>((lookup.texels + 1) * lookup.views * lookup.lights *
                                     images_->info().shape.channels);
  }

 private:
  Device& device_;
  std::shared_ptr<ImageStream> images_;
  std::size_t level_;
};

std::size_t level_bytes(const BtfInfo& info, std::size_t level) {
  return level_info(info, level).image_bytes() * info.shape.images();
}

void copy(Device& device, const Buffer& from, Buffer& to, std::size_t offset, std::size_t bytes) {
  check_cl(clEnqueueCopyBuffer(device.queue(), from.get(), to.get(), 0, offset, bytes, 0, nullptr,
                               nullptr),
           "clEnqueueCopyBuffer");
}

}  // namespace

std::shared_ptr<ImageStream> source_images(Device& device, std::shared_ptr<TileSource> source) {
  return std::make_shared<SourceImages>(device, std::move(source));
}

std::shared_ptr<ImageStream> decoded_images(Device& device, std::shared_ptr<const Model> model) {
  return std::make_shared<DecodedImages>(device, std::move(model));
}

RawLevelsPlan plan_raw_levels(const Device& device, const ImageStream& images, std::size_t first,
                              std::size_t levels, std::size_t memory) {
  const BtfInfo& info = images.info();
  const std::size_t run = image_granule(info.shape);
  RawLevelsPlan plan;
  // A run as it is read, and every level of it in the making.
  plan.streaming_bytes = images.bytes();
  for (std::size_t level = 1; level < levels; ++level) {
    plan.streaming_bytes += run * level_info(info, level).image_bytes();
  }
  const std::size_t room = std::min(memory, device.limits().global_memory);
  plan.first_resident = levels;
  while (plan.first_resident > first) {
    const std::size_t bytes = level_bytes(info, plan.first_resident - 1);
    if (plan.streaming_bytes + plan.resident_bytes + bytes > room) break;
    plan.resident_bytes += bytes;
    --plan.first_resident;
  }
  return plan;
}

std::vector<std::unique_ptr<DeviceSampler>> raw_samplers(Device& device,
                                                         const std::shared_ptr<ImageStream>& images,
                                                         std::size_t first, std::size_t levels,
                                                         const RawLevelsPlan& plan) {
  const BtfInfo& info = images->info();
  const std::size_t run = image_granule(info.shape);
  std::vector<std::unique_ptr<DeviceSampler>> samplers;
  for (std::size_t level = first; level < plan.first_resident; ++level) {
    samplers.push_back(std::make_unique<StreamedSampler>(device, images, level));
  }
  if (plan.first_resident == levels) return samplers;

  std::vector<ResidentLevel> resident;
  for (std::size_t level = plan.first_resident; level < levels; ++level) {
    resident.emplace_back(device, level_info(info, level), run);
  }
  std::vector<Buffer> passing;  // levels on the way to the first that stays
  for (std::size_t level = 1; level < plan.first_resident; ++level) {
    passing.emplace_back(device, run * level_info(info, level).image_bytes(), "reduced images");
  }
  images->for_each([&](std::size_t begin, std::size_t count, const Buffer& raw) {
    const Buffer* values = &raw;
    std::size_t place = 0;  // of the run in `values`
    if (plan.first_resident == 0) {
      copy(device, raw, resident[0].chunk_of(begin), resident[0].place(begin) * info.image_bytes(),
           count * info.image_bytes());
    }
    for (std::size_t level = 1; level < levels; ++level) {
      const BtfInfo finer = level_info(info, level - 1);
      if (level < plan.first_resident) {
        ops::reduce_mip(device, finer, count, place, *values, 0, passing[level - 1]);
        values = &passing[level - 1];
      } else {
        ResidentLevel& target = resident[level - plan.first_resident];
        ops::reduce_mip(device, finer, count, place, *values, target.place(begin),
                        target.chunk_of(begin));
        values = &target.chunk_of(begin);
        place = target.place(begin);
      }
    }
  });
  for (std::size_t level = plan.first_resident; level < levels; ++level) {
    samplers.push_back(std::make_unique<ResidentSampler>(
        device, level_info(info, level), std::move(resident[level - plan.first_resident])));
  }
  return samplers;
}

}  // namespace weft
