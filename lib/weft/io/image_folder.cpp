#include "weft/io/image_folder.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <utility>

#include "weft/error.hpp"
#include "weft/io/atomic_file.hpp"
#include "weft/io/btf_json.hpp"
#include "weft/io/mapped_btf.hpp"
#include "weft/io/ubo_names.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

// Images that wait for each thread: enough that none runs dry between two calls of write().
constexpr std::size_t queued_per_thread = 4;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

BtfInfo stored_info(const BtfInfo& data, const ImageFolderOptions& options,
                    const fs::path& folder) {
  validate(data, folder.string());
  BtfInfo info = data;
  if (options.format == ImageFormat::exr) {
    if (options.exr_dtype != DType::f16 && options.exr_dtype != DType::f32) {
      fail_input("{}: EXR holds F16 or F32, not {}", folder.string(), name_of(options.exr_dtype));
    }
    info.dtype = options.exr_dtype;
    info.encoding = Encoding::linear;
  } else {
    if (info.shape.channels != 1 && info.shape.channels != 3) {
      fail_input("{}: PNG holds 1 or 3 channels, not {}", folder.string(), info.shape.channels);
    }
    info.dtype = DType::u8;
    if (info.encoding == Encoding::linear) info.encoding = Encoding::srgb;
  }
  return info;
}

}  // namespace

ImageFormat image_format_from_name(std::string_view name, std::string_view option) {
  if (name == "exr") return ImageFormat::exr;
  if (name == "png") return ImageFormat::png;
  fail_input("{}: '{}' is none of exr, png", option, name);
}

ImageFolderSink::ImageFolderSink(const fs::path& folder, const BtfInfo& data,
                                 const ImageFolderOptions& options)
    : options_(options),
      info_(stored_info(data, options, folder)),
      output_(folder, options.replace) {
  try {
    // One folder per view: the first of its images names it.
    for (std::size_t view = 0; view < info_.shape.views; ++view) {
      fs::create_directory(output_.temporary() /
                           fs::path(file_name(view * info_.shape.lights)).parent_path());
    }
    const std::size_t count = options_.threads != 0
                                  ? options_.threads
                                  : std::max<std::size_t>(2, std::thread::hardware_concurrency());
    for (std::size_t i = 0; i < count; ++i) threads_.emplace_back([this] { work(); });
  } catch (const std::exception& failure) {
    stop_threads();
    fail_runtime("{}: {}", output_.path().string(), failure.what());
  }
}

ImageFolderSink::~ImageFolderSink() {
  stop_threads();
}

std::size_t ImageFolderSink::queue_bytes() const {
  return (queued_per_thread + 1) * threads_.size() * info_.image_bytes();
}

std::string ImageFolderSink::file_name(std::size_t image) const {
  const std::size_t view = image / info_.shape.lights;
  const std::size_t light = info_.layout == Layout::paired ? view : image % info_.shape.lights;
  return ubo_file_name(image, info_.view_directions[view], info_.light_directions[light],
                       options_.format == ImageFormat::exr ? ".exr" : ".png");
}

double ImageFolderSink::busy_seconds() const {
  const std::lock_guard lock(mutex_);
  return busy_seconds_;
}

std::size_t ImageFolderSink::bytes_written() const {
  const std::lock_guard lock(mutex_);
  return bytes_written_;
}

void ImageFolderSink::check_failure() {
  if (failure_) std::rethrow_exception(failure_);
}

void ImageFolderSink::write(std::size_t first, std::size_t count,
                            std::span<const std::byte> values) {
  std::size_t image = next_image_;
  check_next_images(info_, first, count, values.size(), next_image_, output_.path().string());
  const std::size_t bytes = info_.image_bytes();
  for (; image < next_image_; ++image) {
    check_interrupt();
    Job job;
    job.image = image;
    {
      // Wait for room, and take a used buffer with it.
      const Clock::time_point start = Clock::now();
      std::unique_lock lock(mutex_);
      job_taken_.wait(
          lock, [this] { return failure_ || queue_.size() < queued_per_thread * threads_.size(); });
      wait_seconds_ += seconds_since(start);
      check_failure();
      if (!spare_.empty()) {
        job.values = std::move(spare_.back());
        spare_.pop_back();
      }
    }
    const auto from = values.subspan((image - first) * bytes, bytes);
    job.values.assign(from.begin(), from.end());
    {
      const std::lock_guard lock(mutex_);
      queue_.push_back(std::move(job));
    }
    job_added_.notify_one();
  }
}

void ImageFolderSink::work() {
  while (true) {
    Job job;
    {
      std::unique_lock lock(mutex_);
      job_added_.wait(lock, [this] { return closed_ || !queue_.empty(); });
      if (queue_.empty()) return;
      job = std::move(queue_.front());
      queue_.pop_front();
    }
    job_taken_.notify_one();
    try {
      write_image(job);
      const std::lock_guard lock(mutex_);
      spare_.push_back(std::move(job.values));
    } catch (...) {
      // The first failure is told; the rest of the work is dropped.
      const std::lock_guard lock(mutex_);
      if (!failure_) failure_ = std::current_exception();
      queue_.clear();
      closed_ = true;
      job_added_.notify_all();
      job_taken_.notify_all();
      return;
    }
  }
}

void ImageFolderSink::write_image(const Job& job) {
  const Clock::time_point start = Clock::now();
  const fs::path path = output_.temporary() / file_name(job.image);
  const ImageInfo image{info_.shape.height, info_.shape.width, info_.shape.channels, info_.dtype};
  if (options_.format == ImageFormat::exr) {
    // Channels beyond grey and colour are numbered, so that they come back in order; the manifest
    // has their names.
    write_exr(path, image, job.values, options_.compression);
  } else {
    write_png(path, image, job.values, options_.zlib_level);
  }
  std::error_code ignored;
  const std::uintmax_t size = fs::file_size(path, ignored);
  const std::lock_guard lock(mutex_);
  busy_seconds_ += seconds_since(start);
  if (!ignored) bytes_written_ += size;
}

void ImageFolderSink::stop_threads() noexcept {
  {
    const std::lock_guard lock(mutex_);
    closed_ = true;
    if (next_image_ < info_.shape.images()) queue_.clear();
  }
  job_added_.notify_all();
  for (std::thread& thread : threads_) {
    if (thread.joinable()) thread.join();
  }
}

void ImageFolderSink::write_manifest() const {
  nlohmann::ordered_json root;
  describe(info_, root);
  nlohmann::ordered_json images = nlohmann::ordered_json::array();
  for (std::size_t i = 0; i < info_.shape.images(); ++i) {
    const std::size_t view = i / info_.shape.lights;
    const std::size_t light = info_.layout == Layout::paired ? view : i % info_.shape.lights;
    images.push_back({{"file", file_name(i)}, {"view", view}, {"light", light}});
  }
  root["images"] = std::move(images);
  const std::string text = dump(root, output_.path().string());
  AtomicFile file(output_.temporary() / "manifest.json");
  file.write(std::as_bytes(std::span(text)));
  file.commit();
}

void ImageFolderSink::finish() {
  check_all_images(info_, next_image_, output_.path().string());
  // Let the threads empty the queue and end.
  const Clock::time_point start = Clock::now();
  stop_threads();
  wait_seconds_ += seconds_since(start);
  check_failure();
  write_manifest();
  output_.commit();
}

}  // namespace weft
