// A folder of images as a sink: EXR (half or float) or PNG, encoded and written by several threads.
//
//   FOLDER/manifest.json                                       reads back exactly (see
//   manifest.hpp) FOLDER/tv030_pv030/00008 tl000 pl000 tv030 pv030.exr       number of the image,
//   light, view
//
// Everything goes to a temporary folder beside FOLDER, which takes its name in finish() and is
// removed if that is not reached.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <exception>
#include <filesystem>
#include <mutex>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "weft/btf/tile.hpp"
#include "weft/io/atomic_folder.hpp"
#include "weft/io/image.hpp"

namespace weft {

enum class ImageFormat { exr, png };
// "exr", "png"; throws an input error that names `option`.
ImageFormat image_format_from_name(std::string_view name, std::string_view option);

struct ImageFolderOptions {
  ImageFormat format = ImageFormat::exr;
  ExrCompression compression = ExrCompression::zip;
  DType exr_dtype = DType::f16;  // F16 or F32
  int zlib_level = 4;            // of PNG, 0 to 9
  std::size_t threads = 0;       // 0: as many as the machine has, at least 2
  bool replace = false;          // an existing folder that is not empty gives way
};

class ImageFolderSink final : public TileSink {
 public:
  // `data` describes the BTF whose images will come. info() says in what form they are to be given:
  // for EXR in F16 or F32 and linear light; for PNG in U8, in sRGB if the data are linear and in
  // their own encoding otherwise. Throws an input error if the folder can't be created, is not
  // empty (unless it is to be replaced), or if PNG can't hold the channels.
  ImageFolderSink(const std::filesystem::path& folder, const BtfInfo& data,
                  const ImageFolderOptions& options);
  ~ImageFolderSink() override;

  const BtfInfo& info() const override { return info_; }
  // Queues copies of the images; waits while the queue is full. What failed in a writing thread is
  // thrown here or in finish().
  void write(std::size_t first, std::size_t count, std::span<const std::byte> values) override;
  void finish() override;

  // The name of image i within the folder.
  std::string file_name(std::size_t image) const;

  std::size_t threads() const { return threads_.size(); }
  // The most bytes of images that wait or are being written.
  std::size_t queue_bytes() const;
  // Seconds spent in encoding and in writing files, summed over the threads, so far.
  double busy_seconds() const;
  // Seconds that write() and finish() waited for the writing threads.
  double wait_seconds() const { return wait_seconds_; }
  // Bytes of the image files so far.
  std::size_t bytes_written() const;

 private:
  struct Job {
    std::size_t image = 0;
    std::vector<std::byte> values;
  };

  void work();
  void write_image(const Job& job);
  void write_manifest() const;
  void stop_threads() noexcept;
  void check_failure();

  ImageFolderOptions options_;
  BtfInfo info_;
  AtomicFolder output_;
  std::size_t next_image_ = 0;
  double wait_seconds_ = 0;

  mutable std::mutex mutex_;
  std::condition_variable job_added_;
  std::condition_variable job_taken_;
  std::deque<Job> queue_;
  std::vector<std::vector<std::byte>> spare_;  // buffers to use again
  bool closed_ = false;
  std::exception_ptr failure_;
  double busy_seconds_ = 0;
  std::size_t bytes_written_ = 0;
  std::vector<std::thread> threads_;
};

}  // namespace weft
