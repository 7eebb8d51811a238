#include "weft/btf/adapt.hpp"

#include <cstdint>
#include <cstring>
#include <utility>
#include <vector>

#include "weft/btf/encoding.hpp"
#include "weft/btf/relabelled_source.hpp"

namespace weft {
namespace {

class ConvertedSource final : public TileSource {
 public:
  ConvertedSource(std::shared_ptr<TileSource> source, DType dtype)
      : source_(std::move(source)), info_(source_->info()) {
    info_.dtype = dtype;
  }

  const BtfInfo& info() const override { return info_; }

  void read(std::size_t first, std::size_t count, std::span<std::byte> out) override {
    const BtfInfo& from = source_->info();
    // Image by image, so that one image is all that is held beside the caller's tile.
    for (std::size_t i = 0; i < count; ++i) {
      std::span<const std::byte> values = source_->mapped(first + i, 1);
      if (values.empty()) {
        scratch_.resize(from.image_bytes());
        source_->read(first + i, 1, scratch_);
        values = scratch_;
      }
      convert_values({from.dtype, from.encoding}, values, {info_.dtype, info_.encoding},
                     out.subspan(i * info_.image_bytes(), info_.image_bytes()), info_.source);
    }
  }

  void release(std::size_t first, std::size_t count) override { source_->release(first, count); }

 private:
  std::shared_ptr<TileSource> source_;
  BtfInfo info_;
  std::vector<std::byte> scratch_;
};

// Sets the values of type T whose exponent bits are all set to 0.
template <typename T>
void zero_non_finite(std::span<std::byte> values, T exponent) {
  for (std::size_t i = 0; i < values.size(); i += sizeof(T)) {
    T bits = 0;
    std::memcpy(&bits, values.data() + i, sizeof bits);
    if ((bits & exponent) == exponent) std::memset(values.data() + i, 0, sizeof bits);
  }
}

class FiniteSource final : public TileSource {
 public:
  explicit FiniteSource(std::shared_ptr<TileSource> source) : source_(std::move(source)) {}

  const BtfInfo& info() const override { return source_->info(); }
  void read(std::size_t first, std::size_t count, std::span<std::byte> out) override {
    source_->read(first, count, out);
    if (info().dtype == DType::f16) zero_non_finite<std::uint16_t>(out, 0x7c00);
    if (info().dtype == DType::f32) zero_non_finite<std::uint32_t>(out, 0x7f800000);
  }
  void release(std::size_t first, std::size_t count) override { source_->release(first, count); }

 private:
  std::shared_ptr<TileSource> source_;
};

}  // namespace

std::shared_ptr<TileSource> with_finite_values(std::shared_ptr<TileSource> source) {
  return std::make_shared<FiniteSource>(std::move(source));
}

std::shared_ptr<TileSource> relabelled(std::shared_ptr<TileSource> source,
                                       std::optional<Encoding> encoding,
                                       std::optional<Quantity> quantity) {
  BtfInfo info = source->info();
  info.encoding = encoding.value_or(info.encoding);
  info.quantity = quantity.value_or(info.quantity);
  if (info.encoding == source->info().encoding && info.quantity == source->info().quantity) {
    return source;
  }
  return std::make_shared<RelabelledSource>(std::move(source), std::move(info));
}

std::shared_ptr<TileSource> converted(std::shared_ptr<TileSource> source, DType dtype) {
  if (source->info().dtype == dtype) return source;
  return std::make_shared<ConvertedSource>(std::move(source), dtype);
}

}  // namespace weft
