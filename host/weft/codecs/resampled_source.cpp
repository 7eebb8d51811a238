#include "weft/codecs/resampled_source.hpp"

#include <algorithm>
#include <cstring>
#include <limits>
#include <string_view>
#include <utility>

#include "weft/btf/mode_groups.hpp"
#include "weft/btf/texel_block.hpp"
#include "weft/codecs/scan_source.hpp"
#include "weft/error.hpp"
#include "weft/ops/clamp_values.hpp"
#include "weft/ops/gemm.hpp"
#include "weft/ops/permute.hpp"
#include "weft/reference/resample.hpp"
#include "weft/reference/tile.hpp"

namespace weft {
namespace {

constexpr const char* stage_name = "resample";

// What a block's frames and results may take together: few enough to stay near, enough columns for
// the products.
constexpr std::size_t block_bytes = std::size_t{64} << 20;

std::size_t block_of(const Resampling& resampling, const BtfShape& shape) {
  const std::size_t texel = (resampling.frames.size() + resampling.new_views) *
                            resampling.new_lights * shape.channels * sizeof(float);
  return std::clamp<std::size_t>(block_bytes / texel, 1,
                                 std::min(texel_granule(shape), shape.texels()));
}

Buffer matrix_buffer(Device& device, const std::vector<double>& matrix, const char* what) {
  const std::vector<float> rounded(matrix.begin(), matrix.end());
  Buffer buffer(device, std::max(rounded.size() * sizeof(float), sizeof(float)), what);
  device.write(buffer, std::span<const float>(rounded));
  return buffer;
}

// Frames of which views and matrices go up in equal steps: one batch of products.
struct FrameRun {
  std::size_t first = 0, count = 1;
  std::size_t view_step = 0, matrix_step = 0;
};

std::vector<FrameRun> frame_runs(const std::vector<Resampling::Frame>& frames, std::size_t made) {
  std::vector<FrameRun> runs;
  for (std::size_t f = 0; f < frames.size();) {
    FrameRun run{f, 1, 0, 0};
    const auto& [view, matrix] = frames[f];
    if (f + 1 < frames.size() && frames[f + 1].view >= view && frames[f + 1].lights >= matrix &&
        (view == made) == (frames[f + 1].view == made)) {
      run.view_step = frames[f + 1].view - view;
      run.matrix_step = frames[f + 1].lights - matrix;
    }
    while (f + run.count < frames.size() &&
           frames[f + run.count].view == view + run.count * run.view_step &&
           frames[f + run.count].lights == matrix + run.count * run.matrix_step &&
           (frames[f + run.count].view == made) == (view == made) &&
           (run.view_step > 0 || run.matrix_step > 0)) {
      ++run.count;
    }
    runs.push_back(run);
    f += run.count;
  }
  return runs;
}

}  // namespace

TexelResampler::TexelResampler(Device& device, TileSource& source, const Resampling& resampling,
                               Job& job)
    : device_(device),
      source_(source),
      resampling_(resampling),
      job_(job),
      block_(block_of(resampling, source.info().shape)),
      tiles_(device, source, ModeGroups(source.info().shape, "yxc"), TensorTiles::By::texels, 1.0f,
             job) {}

void TexelResampler::check_values() {
  if (source_.info().dtype != DType::u8) scan_source(device_, source_, job_);
}

void TexelResampler::for_each(std::size_t first_view, std::size_t view_count, const Work& work) {
  const BtfShape& shape = source_.info().shape;
  const std::size_t texel = resampling_.new_lights * block_ * shape.channels * sizeof(float);
  if (!light_matrices_) {
    light_matrices_ = matrix_buffer(device_, resampling_.lights, "matrices of lights");
    view_matrix_ = matrix_buffer(device_, resampling_.views, "matrix of views");
    zenith_weights_ = matrix_buffer(device_, resampling_.zenith, "weights of views");
    frames_ = Buffer(device_, resampling_.frames.size() * texel, "views in new lights");
    if (!resampling_.zenith.empty()) {
      zenith_ =
          Buffer(device_, resampling_.measured_lights * block_ * shape.channels * sizeof(float),
                 "zenith view");
    }
  }
  if (values_.size() < view_count * texel) {
    values_ = Buffer(device_, view_count * texel, "views in new directions");
  }
  tiles_.for_each([&](const Buffer& tile, std::size_t begin, std::size_t values) {
    const std::size_t texels = values / shape.channels;
    for (std::size_t first = 0; first < texels; first += block_) {
      check_interrupt();
      const std::size_t count = std::min(block_, texels - first);
      resample(tile, texels, first, count, first_view, view_count);
      work(values_, begin / shape.channels + first, count);
    }
  });
}

// One block: texels [first, first + count) of a tile [V][L][tile_texels][C].
void TexelResampler::resample(const Buffer& tile, std::size_t tile_texels, std::size_t first,
                              std::size_t count, std::size_t first_view, std::size_t view_count) {
  using ops::row_major, ops::to_row_major;
  const std::size_t C = source_.info().shape.channels;
  const std::size_t V = resampling_.measured_views, L = resampling_.measured_lights;
  const std::size_t lights = resampling_.new_lights, F = resampling_.frames.size();
  const std::size_t row = tile_texels * C, n = count * C;
  // The zenith view, light by light.
  if (zenith_) {
    ops::Operand measured = row_major(device_, tile, L * row, first * C);
    measured.batch = row;
    ops::Result zenith = to_row_major(device_, zenith_, n);
    zenith.batch = n;
    ops::gemm(device_, 1, n, V, 1, row_major(device_, zenith_weights_, V), measured, 0, zenith, L);
  }
  // Lights.
  for (const FrameRun& run : frame_runs(resampling_.frames, V)) {
    const auto& [view, matrix] = resampling_.frames[run.first];
    ops::Operand A = row_major(device_, light_matrices_, L, matrix * lights * L);
    A.batch = run.matrix_step * lights * L;
    ops::Operand B = view == V ? row_major(device_, zenith_, n)
                               : row_major(device_, tile, row, view * L * row + first * C);
    B.batch = run.view_step * L * row;
    ops::Result G = to_row_major(device_, frames_, n, run.first * lights * n);
    G.batch = lights * n;
    ops::gemm(device_, lights, n, L, 1, A, B, 0, G, run.count);
  }
  // Views.
  ops::gemm(device_, view_count, lights * n, F, 1,
            row_major(device_, view_matrix_, F, first_view * F),
            row_major(device_, frames_, lights * n), 0, to_row_major(device_, values_, lights * n));
  const float largest = resampling_.largest > 0 ? static_cast<float>(resampling_.largest)
                                                : std::numeric_limits<float>::infinity();
  ops::clamp_values(device_, view_count * lights * n, largest, values_);
}

std::size_t TexelResampler::bytes(std::size_t view_count) const {
  const std::size_t n = block_ * source_.info().shape.channels;
  const std::size_t F = resampling_.frames.size(), L = resampling_.measured_lights;
  const std::size_t matrices =
      resampling_.lights.size() + resampling_.views.size() + resampling_.zenith.size() + 1;
  const std::size_t blocks =
      (F + view_count) * resampling_.new_lights * n + (resampling_.zenith.empty() ? 0 : L * n);
  const std::size_t packed =
      std::max({ops::gemm_bytes(device_, n, L, Arithmetic::f32, F),
                ops::gemm_bytes(device_, resampling_.new_lights * n, F),
                ops::gemm_bytes(device_, n, resampling_.measured_views, Arithmetic::f32, L)});
  // matrices here, too, as they are rounded
  return tiles_.bytes() + packed + (2 * matrices + blocks) * sizeof(float);
}

double TexelResampler::flops(std::size_t view_count) const {
  const BtfShape& shape = source_.info().shape;
  const auto F = static_cast<double>(resampling_.frames.size());
  const auto lights = static_cast<double>(resampling_.new_lights);
  const double macs =
      lights * F * (static_cast<double>(shape.lights) + static_cast<double>(view_count)) +
      static_cast<double>(resampling_.zenith.size() * shape.lights);
  return 2 * macs * static_cast<double>(shape.image_values());
}

void order_by_texel(Device& device, const Resampling& resampling, std::size_t channels,
                    std::size_t count, const Buffer& values, Buffer& texels) {
  const std::size_t directions = resampling.new_views * resampling.new_lights;
  ops::permute(device, {count, directions, channels}, {channels, count * channels, 1}, values, 0,
               texels);
}

ResampledSource::ResampledSource(Device* device, TileSource& source, Resampling resampling,
                                 Job& job)
    : source_(source), resampling_(std::move(resampling)), job_(job) {
  if (device) resampler_ = std::make_unique<TexelResampler>(*device, source, resampling_, job);
  plan();
  check_values();
}

void ResampledSource::check_values() {
  if (resampler_) return resampler_->check_values();
  if (source_.info().dtype == DType::u8) return;
  std::vector<double> image(source_.info().shape.image_values());
  for (std::size_t i = 0; i < source_.info().shape.images(); ++i) {
    check_interrupt();
    reference::read_tile(source_, i, 1, job_.nan_zero, image);
  }
}

void ResampledSource::plan() {
  const BtfShape& shape = source_.info().shape;
  const std::size_t view_bytes = resampling_.new_lights * shape.image_values() * sizeof(float);
  const std::size_t matrices =
      (resampling_.lights.size() + resampling_.views.size() + resampling_.zenith.size()) *
      sizeof(double);
  const auto planned = [&](std::size_t views) {
    MemoryPlan plan;
    plan.add("resampled views", views * view_bytes);
    plan.add("matrices of directions", matrices);
    if (resampler_) {
      const std::size_t block = resampler_->block_texels() * shape.channels *
                                resampling_.new_lights * views * sizeof(float);
      plan.add("resampling", resampler_->bytes(views) + block);
    } else {
      const std::size_t values = shape.images() +
                                 (resampling_.frames.size() + views) * resampling_.new_lights +
                                 (resampling_.zenith.empty() ? 0 : shape.lights);
      const std::size_t texels = block_of(resampling_, shape);
      plan.add("resampling", values * texels * shape.channels * (sizeof(double) + sizeof(float)) +
                                 2 * source_.info().image_bytes());
    }
    plan.limit = job_.memory;
    return plan;
  };
  std::size_t held = 0;
  for (const MemoryItem& item : job_.held) held += item.bytes;
  std::size_t views = resampling_.new_views;
  while (views > 1 && planned(views).total() + held > job_.memory) views = (views + 1) / 2;
  views_of_pass_ = views;
  job_.plan(planned(views));
}

void ResampledSource::read(std::size_t first, std::size_t count, std::span<std::byte> out) {
  const std::size_t image = resampling_.info.shape.image_values();
  // Image i is light i % L' of new view i / L', in pairs as in a grid.
  for (std::size_t i = first; i < first + count; ++i) {
    const std::size_t view = i / resampling_.new_lights;
    if (view < held_view_ || view >= held_view_ + held_views_) {
      hold(view / views_of_pass_ * views_of_pass_);
    }
    const std::size_t at = (i - held_view_ * resampling_.new_lights) * image;
    std::memcpy(out.data() + (i - first) * image * sizeof(float), held_.data() + at,
                image * sizeof(float));
  }
}

void ResampledSource::hold(std::size_t first_view) {
  const std::size_t count = std::min(views_of_pass_, resampling_.new_views - first_view);
  held_.resize(count * resampling_.new_lights * source_.info().shape.image_values());
  held_view_ = first_view;
  held_views_ = count;
  if (resampler_) {
    hold_by_device(first_view, count);
  } else {
    hold_by_reference(first_view, count);
  }
}

void ResampledSource::hold_by_device(std::size_t first_view, std::size_t view_count) {
  const BtfShape& shape = source_.info().shape;
  const StageTimer timer(job_, stage_name, resampler_->flops(view_count),
                         static_cast<double>(source_.info().bytes()));
  std::vector<float> block(view_count * resampling_.new_lights * resampler_->block_texels() *
                           shape.channels);
  resampler_->for_each(
      first_view, view_count, [&](const Buffer& values, std::size_t first, std::size_t count) {
        const std::span<float> part =
            std::span(block).first(view_count * resampling_.new_lights * count * shape.channels);
        resampler_->device().read(values, part);
        place(part, first, count);
        job_.advance(stage_name, first + count, shape.texels());
      });
}

void ResampledSource::hold_by_reference(std::size_t first_view, std::size_t view_count) {
  const BtfShape& shape = source_.info().shape;
  const StageTimer timer(job_, stage_name, 0, static_cast<double>(source_.info().bytes()));
  const std::size_t block = block_of(resampling_, shape);
  const std::size_t texel = shape.images() * shape.channels;
  std::vector<std::byte> raw;
  std::vector<double> values;
  for (std::size_t first = 0; first < shape.texels(); first += block) {
    check_interrupt();
    const std::size_t count = std::min(block, shape.texels() - first);
    raw.resize(count * texel * size_of(source_.info().dtype));
    values.resize(count * texel);
    read_texels(source_, first, count, raw);
    reference::to_double(source_.info().dtype, raw, job_.nan_zero, values);
    const std::vector<double> resampled =
        reference::resample(resampling_, count * shape.channels, values, first_view, view_count);
    place(std::vector<float>(resampled.begin(), resampled.end()), first, count);
    job_.advance(stage_name, first + count, shape.texels());
  }
}

void ResampledSource::place(std::span<const float> values, std::size_t first, std::size_t count) {
  const std::size_t P = source_.info().shape.texels(), C = source_.info().shape.channels;
  for (std::size_t image = 0; image < held_views_ * resampling_.new_lights; ++image) {
    std::memcpy(held_.data() + (image * P + first) * C, values.data() + image * count * C,
                count * C * sizeof(float));
  }
}

}  // namespace weft
