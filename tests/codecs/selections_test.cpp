// Selections and every codec of the table: only what is selected is touched, a model of a part is
// that of the part alone, and parts of models know what they are of the whole.
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstring>
#include <memory>
#include <new>
#include <span>
#include <vector>

#include "codecs/codec_runs.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/memory_btf.hpp"
#include "weft/btf/recorded_selection.hpp"

namespace weft::test {
namespace {

class SelectedCodec : public testing::TestWithParam<CodecRun> {
 protected:
  const CodecRun& run() const { return GetParam(); }
};

INSTANTIATE_TEST_SUITE_P(Table, SelectedCodec, testing::ValuesIn(every_run()), run_name);

// A mapped source, each image on pages of its own; those of images that are `forbidden` can't be
// touched without the process ending.
class ForbiddingSource final : public TileSource {
 public:
  ForbiddingSource(MemorySource& values, const std::vector<bool>& forbidden)
      : info_(values.info()),
        page_(static_cast<std::size_t>(sysconf(_SC_PAGESIZE))),
        forbidden_(forbidden) {
    const std::size_t bytes = info_.bytes();
    void* const pages =
        mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (pages == MAP_FAILED) throw std::bad_alloc();
    pages_ = {static_cast<std::byte*>(pages), bytes};
    std::memcpy(pages_.data(), values.bytes().data(), bytes);
    for (std::size_t image = 0; image < forbidden.size(); ++image) {
      if (forbidden[image]) mprotect(images(image, 1).data(), info_.image_bytes(), PROT_NONE);
    }
  }
  ~ForbiddingSource() override { munmap(pages_.data(), pages_.size()); }
  ForbiddingSource(const ForbiddingSource&) = delete;
  ForbiddingSource& operator=(const ForbiddingSource&) = delete;

  bool fits_pages() const { return info_.image_bytes() % page_ == 0; }
  const BtfInfo& info() const override { return info_; }
  void read(std::size_t first, std::size_t count, std::span<std::byte> out) override {
    std::memcpy(out.data(), images(first, count).data(), out.size());
  }
  std::span<const std::byte> mapped(std::size_t first, std::size_t count) override {
    return images(first, count);
  }
  void prefetch(std::size_t first, std::size_t count) override { expect_allowed(first, count); }
  void release(std::size_t first, std::size_t count) override { expect_allowed(first, count); }

 private:
  std::span<std::byte> images(std::size_t first, std::size_t count) const {
    return pages_.subspan(first * info_.image_bytes(), count * info_.image_bytes());
  }
  void expect_allowed(std::size_t first, std::size_t count) const {
    for (std::size_t image = first; image < first + count; ++image) {
      EXPECT_FALSE(forbidden_[image]) << "image " << image;
    }
  }

  BtfInfo info_;
  std::size_t page_;
  std::vector<bool> forbidden_;
  std::span<std::byte> pages_;
};

// The model of a selection is that of a source that holds nothing else, bit by bit, and of what is
// not selected not a byte is read.
TEST_P(SelectedCodec, NothingElseIsRead) {
  const BtfShape shape{4, 5, 16, 64, 2};
  const auto whole = random_source(shape, DType::f16, 5);
  Selection views;
  views.views = {{1, 2}};
  Selection apart;
  apart.views = {{3, 0}};
  apart.lights = {{4, 1, 2}};
  Selection texels = apart;
  texels.region = Region{3, 2, 21, 11};
  texels.channels = {{1}};
  Selection level = texels;
  level.level = 1;
  for (const Selection& selection : {views, apart, texels, level}) {
    std::vector<bool> forbidden(shape.images(), true);
    for (const std::size_t v : *selection.views) {
      for (std::size_t l = 0; l < shape.lights; ++l) {
        const auto& lights = selection.lights;
        const bool selected =
            !lights || std::find(lights->begin(), lights->end(), l) != lights->end();
        if (selected) forbidden[v * shape.lights + l] = false;
      }
    }
    const auto guarded = std::make_shared<ForbiddingSource>(*whole, forbidden);
    ASSERT_TRUE(guarded->fits_pages());
    const auto selected = select(guarded, selection);
    std::vector<std::byte> values(selected->info().bytes());
    selected->read(0, selected->info().shape.images(), values);
    MemorySource alone(selected->info(), values);
    const Parameters parameters{{"rank", "2"}};
    const auto model = run().encode(*selected, parameters, Storage::f16);
    EXPECT_EQ(tensor_bytes(*model), tensor_bytes(*run().encode(alone, parameters, Storage::f16)))
        << to_json(selection);
    EXPECT_EQ(run().measure(*model, *selected).square_difference,
              run().measure(*model, alone).square_difference);
  }
}

// Parts of parts, by their records in the numbers of the whole.
TEST_P(SelectedCodec, PartsOfModelsKnowWhatTheyAre) {
  const BtfShape shape{5, 6, 8, 12, 3};
  const auto source = random_source(shape, DType::f16, 5);
  RecordedSelection fitted;
  fitted.views = {{4, 0, 3}};
  fitted.region = Region{1, 2, 10, 6};
  fitted.of = shape;
  const auto part_source = select(source, fitted);
  const auto model = run().encode(*part_source, {{"rank", "3"}}, Storage::f16);
  model->info.selection = to_json(fitted);
  const std::vector<double> whole = run().decode(*model, 6);

  Selection narrower;
  narrower.views = {{2, 0}};
  narrower.lights = {{5}};
  narrower.region = Region{2, 1, 4, 3};
  narrower.channels = {{1}};
  const auto part = run().get().select(*model, narrower);
  EXPECT_EQ(part->info.selection,
            R"({"views":[3,4],"lights":[5],"region":{"x":3,"y":3,"width":4,"height":3},)"
            R"("channels":[1],"of":[5,6,8,12,3]})");
  EXPECT_EQ(part->info.btf.shape, (BtfShape{2, 1, 3, 4, 1}));
  EXPECT_FALSE(part->info.errors.has_value());

  if (const auto next = run().get().next_mip_level(*model)) {
    EXPECT_EQ(next->info.selection,
              R"({"views":[4,0,3],"region":{"x":1,"y":2,"width":10,"height":6},"level":1,)"
              R"("of":[5,6,8,12,3]})");
    held_part(next->info.btf, recorded_from_json(next->info.selection, "m"), "m");
  }
  // a record that does not fit the model
  model->info.selection = R"({"views":[0,1]})";
  expect_error(ErrorKind::input, {"selection", "2 views for 3"},
               [&] { run().get().select(*model, narrower); });
}

}  // namespace
}  // namespace weft::test
