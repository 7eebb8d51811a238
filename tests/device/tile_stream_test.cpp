// Streams of mapped and of read sources: every image once and in order, as much at a time as asked
// for, nothing reused before the device is done with it, and a clean end after any error.
#include "weft/device/tile_stream.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

#include "device/spin.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/memory_btf.hpp"
#include "support/process.hpp"
#include "weft/error.hpp"

namespace weft::test {
namespace {

constexpr BtfShape shape{3, 4, 5, 7, 3};
constexpr std::size_t images = 12;
constexpr std::uint64_t some_milliseconds = 1 << 21;  // rounds of the spin kernel

// Says what is done with it.
class WatchedSource final : public TileSource {
 public:
  explicit WatchedSource(bool mapped)
      : memory_(make_info(shape, DType::f32),
                encode_values(random_values(shape.values(), 11), DType::f32), mapped) {}

  const BtfInfo& info() const override { return memory_.info(); }
  void read(std::size_t first, std::size_t count, std::span<std::byte> out) override {
    if (on_read) on_read(first, count);
    memory_.read(first, count, out);
  }
  std::span<const std::byte> mapped(std::size_t first, std::size_t count) override {
    return memory_.mapped(first, count);
  }
  void release(std::size_t first, std::size_t count) override {
    if (on_release) on_release(first, count);
  }
  std::span<const std::byte> bytes() const { return memory_.bytes(); }
  std::size_t largest_read() const { return memory_.largest_read(); }

  // Called before the images are read, and as they are released.
  std::function<void(std::size_t first, std::size_t count)> on_read;
  std::function<void(std::size_t first, std::size_t count)> on_release;

 private:
  MemorySource memory_;
};

bool complete(const Handle<cl_event>& event) {
  cl_int status = CL_QUEUED;
  clGetEventInfo(event.get(), CL_EVENT_COMMAND_EXECUTION_STATUS, sizeof status, &status, nullptr);
  return status == CL_COMPLETE;
}

Handle<cl_event> marker(Device& device) {
  cl_event event = nullptr;
  check_cl(clEnqueueMarkerWithWaitList(device.queue(), 0, nullptr, &event), "marker");
  device.flush();
  return Handle<cl_event>(event);
}

// Sources by how they give their images.
class TileStreams : public testing::TestWithParam<bool> {
 protected:
  bool mapped() const { return GetParam(); }
  // Whether images are used where they lie.
  bool in_place() const { return mapped() && device_.limits().unified_memory; }

  Device device_{"auto"};
};

INSTANTIATE_TEST_SUITE_P(Sources, TileStreams, testing::Bool(), [](const auto& info) {
  return info.param ? std::string("Mapped") : std::string("Read");
});

TEST_P(TileStreams, EveryImageOnceAndInOrder) {
  for (const std::size_t granule :
       Sizes{1, 2, 5, images - 1, images, images + 1, std::size_t{1} << 40}) {
    SCOPED_TRACE(granule);
    WatchedSource source(mapped());
    std::size_t released = 0;
    source.on_release = [&](std::size_t first, std::size_t count) {
      EXPECT_EQ(first, released);
      released += count;
    };
    TileStream stream(device_, source, granule);
    // twice, as an iteration does
    for (int pass = 0; pass < 2; ++pass) {
      std::size_t next = 0;
      released = 0;
      stream.for_each([&](std::size_t first, std::size_t count, const Buffer& raw) {
        EXPECT_EQ(first, next);
        EXPECT_EQ(count, std::min(granule, images - first));
        const std::size_t bytes = count * source.info().image_bytes();
        ASSERT_GE(raw.size(), bytes);
        std::vector<std::byte> actual(bytes);
        device_.read(raw, 0, actual);
        const auto expected = source.bytes().subspan(first * source.info().image_bytes(), bytes);
        EXPECT_TRUE(std::equal(expected.begin(), expected.end(), actual.begin()));
        next += count;
      });
      EXPECT_EQ(next, images);
      EXPECT_EQ(released, images);
    }
    EXPECT_LE(source.largest_read(), std::min(granule, images));
  }
}

// Kernels that are still in the queue when `work` returns see the images of their own run.
TEST_P(TileStreams, SlowKernelsSeeTheirOwnImages) {
  WatchedSource source(mapped());
  Buffer sink(device_, sizeof(float), "sink");
  Buffer copy(device_, source.info().bytes(), "copy");
  TileStream stream(device_, source, 1);
  stream.for_each([&](std::size_t first, std::size_t count, const Buffer& raw) {
    const std::size_t bytes = source.info().image_bytes();
    enqueue_spin(device_, raw, some_milliseconds, sink);
    check_cl(clEnqueueCopyBuffer(device_.queue(), raw.get(), copy.get(), 0, first * bytes,
                                 count * bytes, 0, nullptr, nullptr),
             "copy");
  });
  std::vector<std::byte> actual(copy.size());
  device_.read(copy, 0, actual);
  EXPECT_TRUE(std::equal(actual.begin(), actual.end(), source.bytes().begin()));
}

TEST_P(TileStreams, PagesAreReleasedOnlyAfterTheirUse) {
  WatchedSource source(mapped());
  Buffer sink(device_, sizeof(float), "sink");
  std::vector<Handle<cl_event>> done(images);
  std::size_t released = 0;
  source.on_release = [&](std::size_t first, std::size_t count) {
    released += count;
    // A source that is read has been copied by then.
    EXPECT_TRUE(!in_place() || complete(done.at(first)));
  };
  TileStream(device_, source, 1).for_each([&](std::size_t first, std::size_t, const Buffer& raw) {
    enqueue_spin(device_, raw, some_milliseconds, sink);
    done.at(first) = marker(device_);
  });
  device_.finish();
  EXPECT_EQ(released, images);
}

TEST(TileStream, ReadsAtMostOneRunAheadOfTheDevice) {
  Device device("auto");
  WatchedSource source(false);
  std::atomic<std::size_t> begun{0};
  std::atomic<bool> too_far{false};
  source.on_read = [&](std::size_t first, std::size_t) {
    // Two runs fit before any work; after that each waits for the run whose place it takes.
    if (first >= 2 && begun < first) too_far = true;
  };
  Buffer sink(device, sizeof(float), "sink");
  TileStream(device, source, 1).for_each([&](std::size_t, std::size_t, const Buffer& raw) {
    ++begun;
    enqueue_spin(device, raw, some_milliseconds, sink);
  });
  EXPECT_FALSE(too_far);
  EXPECT_EQ(source.largest_read(), 1U);
}

TEST(TileStream, BufferBytesAreThoseOfTwoRuns) {
  Device device("auto");
  WatchedSource read(false);
  const std::size_t image = read.info().image_bytes();
  const std::size_t copies = device.limits().unified_memory ? 2 : 4;
  EXPECT_EQ(TileStream(device, read, 3).buffer_bytes(), copies * 3 * image);
  EXPECT_EQ(TileStream(device, read, images + 9).buffer_bytes(), copies * images * image);
  WatchedSource mapped(true);
  if (device.limits().unified_memory) {
    EXPECT_EQ(TileStream(device, mapped, 3).buffer_bytes(), 0U);
  }
}

TEST(TileStream, AnErrorOfTheSourceArrivesAfterTheRunsBeforeIt) {
  Device device("auto");
  const std::size_t handles = live_cl_handles();
  for (const std::size_t bad : Sizes{0, 1, 5, images - 1}) {
    SCOPED_TRACE(bad);
    WatchedSource source(false);
    source.on_read = [&](std::size_t first, std::size_t) {
      if (first == bad) fail_input("picture {} can't be read", first);
    };
    std::size_t worked = 0;
    TileStream stream(device, source, 1);
    expect_error(ErrorKind::input, {"picture " + std::to_string(bad)}, [&] {
      stream.for_each([&](std::size_t first, std::size_t, const Buffer&) {
        EXPECT_EQ(first, worked);
        ++worked;
      });
    });
    EXPECT_EQ(worked, bad);
    EXPECT_EQ(live_cl_handles(), handles);
    // and again, once the cause is gone
    source.on_read = nullptr;
    std::size_t count = 0;
    stream.for_each([&](std::size_t, std::size_t, const Buffer&) { ++count; });
    EXPECT_EQ(count, images);
  }
}

// What the work throws ends the pass, and no kernel reads the source's memory any more: its owner
// may be about to free it.
TEST_P(TileStreams, AnErrorOfTheWorkEndsThePassWithAnIdleDevice) {
  const Buffer warm_in(device_, 1, "in");
  Buffer sink(device_, sizeof(float), "sink");
  enqueue_spin(device_, warm_in, 1, sink);
  device_.finish();
  for (const std::size_t bad : Sizes{0, 1, images - 1}) {
    SCOPED_TRACE(bad);
    WatchedSource source(mapped());
    const std::size_t handles = live_cl_handles();
    Handle<cl_event> last;
    EXPECT_THROW(TileStream(device_, source, 1)
                     .for_each([&](std::size_t first, std::size_t, const Buffer& raw) {
                       enqueue_spin(device_, raw, 4 * some_milliseconds, sink);
                       last = marker(device_);
                       if (first == bad) throw std::length_error("work failed");
                     }),
                 std::length_error);
    EXPECT_TRUE(complete(last));
    last.reset();
    EXPECT_EQ(live_cl_handles(), handles);
  }
}

// A stop asked for concerns the whole process, so it has its own.
TEST(TileStream, DISABLED_InAProcessThatIsStopped) {
  Device device("auto");
  for (const bool mapped : {true, false}) {
    WatchedSource source(mapped);
    std::size_t worked = 0;
    expect_error(ErrorKind::interrupted, {"interrupted"}, [&] {
      TileStream(device, source, 1).for_each([&](std::size_t, std::size_t, const Buffer&) {
        if (++worked == 3) request_interrupt();
      });
    });
    // the second pass finds the stop already asked for
    EXPECT_EQ(worked, mapped ? 3U : 0U);
  }
}

TEST(TileStream, AStopAskedForEndsThePassBeforeTheNextRun) {
  const ProcessResult result = run_process({"/proc/self/exe", "--gtest_also_run_disabled_tests",
                                            "--gtest_filter=TileStream.DISABLED_InAProcess*"});
  EXPECT_EQ(result.status, 0) << result.out << result.err;
  EXPECT_NE(result.out.find("[  PASSED  ] 1 test."), std::string::npos) << result.out;
}

TEST(ImageGranule, IsWithinTheImagesAndTheWorkingSet) {
  // enough rows for a product, however small the images are
  EXPECT_EQ(image_granule({10, 10, 1, 1, 3}), 64U);
  EXPECT_EQ(image_granule({10, 10, 1, 1, 7}), 28U);
  // no more than there are
  EXPECT_EQ(image_granule({2, 3, 8, 8, 1}), 6U);
  // 16 MiB of floats: 128 x 128 x 3 is 196608 bytes
  EXPECT_EQ(image_granule({81, 81, 128, 128, 3}), 64U);
  EXPECT_EQ(image_granule({81, 81, 256, 256, 3}), 21U);
  // one image, if that alone is more
  EXPECT_EQ(image_granule({9, 9, 4096, 4096, 3}), 1U);
}

}  // namespace
}  // namespace weft::test
