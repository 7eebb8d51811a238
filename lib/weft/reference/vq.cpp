#include "weft/reference/vq.hpp"

#include <algorithm>
#include <cmath>
#include <future>
#include <numeric>
#include <utility>

#include "weft/btf/texel_block.hpp"
#include "weft/error.hpp"
#include "weft/reference/similar_code_vector.hpp"
#include "weft/reference/tile.hpp"

namespace weft {
namespace {

// Texels whose code-vectors are found together: see vq_code_books.hpp.
constexpr std::size_t batch = 64;

// The second step's thresholds are 2.5 times the first's: of mean squares, and of dissimilarities,
// which are as squares where they are small.
constexpr double second_step = 2.5;

// Bytes of a plane of texels that are read together with what is about them.
constexpr std::size_t read_bytes = std::size_t{32} << 20;

// Van der Corput's sequence: the digits of i mirrored at the point.
double radical_inverse(std::size_t i, std::size_t base) {
  double value = 0;
  double place = 1;
  for (; i > 0; i /= base) {
    place /= static_cast<double>(base);
    value += place * static_cast<double>(i % base);
  }
  return value;
}

std::size_t part_of(double part, std::size_t whole, std::size_t least, std::size_t most) {
  const auto count = static_cast<std::size_t>(std::ceil(part * static_cast<double>(whole)));
  return std::min(std::clamp(count, least, most), whole);
}

// A search that counts the operations of looking at all code-vectors, by squared error.
class CountingSearch final : public NearestSearch {
 public:
  explicit CountingSearch(NearestSearch& search) : search_(search) {}

  double flops() const { return flops_; }

  void set(const VectorShape& shape, std::span<const float> code_vectors) override {
    values_ = code_vectors.size();
    search_.set(shape, code_vectors);
  }
  std::vector<std::uint32_t> nearest(const ScaledVectors& vectors, double most) override {
    flops_ += 2.0 * static_cast<double>(vectors.scales.size()) * static_cast<double>(values_);
    return search_.nearest(vectors, most);
  }
  double distance(const VectorShape& shape, const ScaledVectors& vector, const float* code_vector,
                  double most) const override {
    return search_.distance(shape, vector, code_vector, most);
  }
  double distance_of(double threshold, const VectorShape& shape) const override {
    return search_.distance_of(threshold, shape);
  }

 private:
  NearestSearch& search_;
  std::size_t values_ = 0;
  double flops_ = 0;
};

double root_mean_square(std::span<const float> rows, const VectorShape& shape) {
  double sum = 0;
  for (std::size_t row = 0; row < rows.size(); row += shape.values()) {
    for (std::size_t i = 0; i < shape.luminances; ++i) {
      sum += double{rows[row + i]} * double{rows[row + i]};
    }
  }
  const std::size_t count = rows.size() / shape.values() * shape.luminances;
  return std::sqrt(sum / static_cast<double>(std::max<std::size_t>(count, 1)));
}

}  // namespace

void scale_all(std::span<float> values, int exponent) {
  if (exponent == 0) return;
  const double factor = std::ldexp(1.0, exponent);
  for (float& value : values) value = static_cast<float>(double{value} * factor);
}

VqTraining vq_training(const BtfShape& shape, const VqRequest& request) {
  VqTraining training;
  const std::size_t P = shape.texels();
  training.first = part_of(request.first_part, P, 256, 1024);
  const std::size_t second =
      std::min(part_of(request.second_part, P, 768, 3072), P - training.first);
  const std::size_t wanted = training.first + second;
  std::vector<bool> taken(P, false);
  const auto take = [&](std::size_t p) {
    if (training.texels.size() == wanted || taken[p]) return;
    taken[p] = true;
    training.texels.push_back(p);
  };
  for (std::size_t i = 1; i <= 8 * P && training.texels.size() < wanted; ++i) {
    const double across = radical_inverse(i, 2) * static_cast<double>(shape.width);
    const double down = radical_inverse(i, 3) * static_cast<double>(shape.height);
    take(std::min(static_cast<std::size_t>(down), shape.height - 1) * shape.width +
         std::min(static_cast<std::size_t>(across), shape.width - 1));
  }
  for (std::size_t p = 0; p < P; ++p) take(p);
  return training;
}

std::size_t vq_block(const BtfInfo& source, const VqRequest& request) {
  constexpr std::size_t bytes = std::size_t{32} << 20;
  constexpr std::size_t vectors = 64;
  const std::size_t row =
      texel_vector(request.grid, source.shape.channels).values() * sizeof(float);
  return std::min(std::max<std::size_t>(bytes / row / vectors, 1) * vectors, source.shape.texels());
}

// Whole rows of the image where there are windows about texels: rows that are read again for the
// next block's windows are then few.
std::size_t vq_read_block(const BtfInfo& source, const VqRequest& request) {
  const BtfShape& shape = source.shape;
  if (request.similarity == VqSimilarity::mse) return vq_block(source, request);
  const std::size_t row = shape.images() * shape.width * shape.channels * sizeof(float);
  return std::min(std::max<std::size_t>(read_bytes / row, 1), shape.height) * shape.width;
}

MemoryPlan plan_vq(const BtfInfo& source, const VqRequest& request, std::size_t trained,
                   const Job& job) {
  const BtfShape& shape = source.shape;
  const std::size_t row = texel_vector(request.grid, shape.channels).values() * sizeof(float);
  const std::size_t measured = shape.images() * shape.channels;
  const VqTraining training = vq_training(shape, request);
  const std::size_t count = vq_block(source, request);
  const bool structural = request.similarity == VqSimilarity::ssim;
  const std::size_t planes = structural ? 3 : 1;
  MemoryPlan plan;
  plan.limit = job.memory;
  plan.items = job.held;
  plan.add("an image", shape.image_values() * (sizeof(double) + sizeof(float)));
  plan.add("texels for the code-books", training.texels.size() * measured * planes * sizeof(float));
  const std::size_t read = vq_read_block(source, request);
  if (structural) {
    plan.add("texels that are read", 2 * read * measured * planes * sizeof(float));
    plan.add("a block of texels", count * (measured * sizeof(float) + (planes + 2) * row));
  } else {
    plan.add("a block of texels",
             count * (measured * (sizeof(double) + 3 * sizeof(float)) + 3 * row));
  }
  // all of the texels, each on four levels, at most; a quarter of the memory, where that is less
  plan.add("code-vectors", std::min(4 * trained * row, job.memory / 4));
  return plan;
}

VqFitter::VqFitter(TileSource& source, VqEngine& engine, const VqRequest& request, Job& job)
    : source_(source),
      engine_(engine),
      request_(request),
      job_(job),
      shape_(source.info().shape),
      vector_(texel_vector(request.grid, shape_.channels)),
      training_(vq_training(shape_, request)),
      moments_(shape_.height, shape_.width, shape_.channels),
      row_by_row_(training_.texels.size()) {
  std::iota(row_by_row_.begin(), row_by_row_.end(), std::size_t{0});
  std::sort(row_by_row_.begin(), row_by_row_.end(), [&](std::size_t a, std::size_t b) {
    return training_.texels[a] < training_.texels[b];
  });
}

void VqFitter::make_room(Measured& measured, std::size_t texels) const {
  const std::size_t values = shape_.images() * texels * shape_.channels;
  measured.texels = texels;
  measured.values.resize(values);
  if (!structural()) return;
  measured.means.resize(values);
  measured.deviations.resize(values);
}

void VqFitter::scale(Measured& measured) const {
  for (std::vector<float>* plane : {&measured.values, &measured.means, &measured.deviations}) {
    scale_all(*plane, unit_);
  }
}

double VqFitter::read() {
  const StageTimer timer(job_, "scan", 0, static_cast<double>(source_.info().bytes()));
  make_room(kept_, training_.texels.size());
  std::vector<double> image(shape_.image_values());
  double largest = 0;
  float* to = kept_.values.data();
  for (std::size_t i = 0; i < shape_.images(); ++i) {
    check_interrupt();
    reference::read_tile(source_, i, 1, job_.nan_zero, image);
    for (const double value : image) largest = std::max(largest, std::abs(value));
    for (const std::size_t p : training_.texels) {
      for (std::size_t c = 0; c < shape_.channels; ++c) {
        *to++ = static_cast<float>(image[p * shape_.channels + c]);
      }
    }
    if (structural()) keep_moments(image, i);
    job_.advance("scan", i + 1, shape_.images());
  }
  return largest;
}

void VqFitter::set_unit(int unit) {
  unit_ = unit;
  scale(kept_);
}

void VqFitter::keep_moments(std::span<const double> image, std::size_t i) {
  const std::size_t C = shape_.channels;
  std::size_t row = shape_.height;
  for (const std::size_t n : row_by_row_) {
    const std::size_t p = training_.texels[n];
    if (p / shape_.width != row) {
      row = p / shape_.width;
      moments_.take_row(image, 0, row);
    }
    const std::size_t at = (i * training_.texels.size() + n) * C;
    moments_.about(p % shape_.width, std::span(kept_.means).subspan(at, C),
                   std::span(kept_.deviations).subspan(at, C));
  }
}

void VqFitter::read_block(std::size_t first, std::size_t count, Measured& block) {
  make_room(block, count);
  if (structural()) {
    read_with_moments(first, count, block);
  } else {
    const DType dtype = source_.info().dtype;
    std::vector<double> exact(block.values.size());
    std::vector<std::byte> raw(exact.size() * size_of(dtype));
    read_texels(source_, first, count, raw);
    reference::to_double(dtype, raw, job_.nan_zero, exact);
    std::copy(exact.begin(), exact.end(), block.values.begin());
  }
  scale(block);
}

void VqFitter::read_with_moments(std::size_t first, std::size_t count, Measured& block) {
  const std::size_t C = shape_.channels;
  const std::size_t width = shape_.width;
  const DType dtype = source_.info().dtype;
  const LocalMoments::Band band = moments_.band(first / width, (first + count - 1) / width + 1);
  std::vector<double> rows((band.end - band.first) * width * C);
  std::vector<std::byte> raw(rows.size() * size_of(dtype));
  std::vector<std::byte> whole;
  for (std::size_t i = 0; i < shape_.images(); ++i) {
    check_interrupt();
    read_image_texels(source_, i, band.first * width, (band.end - band.first) * width, whole, raw);
    source_.release(i, 1);
    reference::to_double(dtype, raw, job_.nan_zero, rows);
    for (std::size_t p = first; p < first + count; ++p) {
      if (p == first || p % width == 0) moments_.take_row(rows, band.first, p / width);
      const std::size_t at = (i * count + p - first) * C;
      moments_.about(p % width, std::span(block.means).subspan(at, C),
                     std::span(block.deviations).subspan(at, C));
      const auto value = rows.begin() + static_cast<std::ptrdiff_t>((p - band.first * width) * C);
      std::copy_n(value, C, block.values.begin() + static_cast<std::ptrdiff_t>(at));
    }
  }
}

VqFitter::Vectors VqFitter::vectors(const Measured& measured, std::size_t first,
                                    std::size_t count) const {
  const std::size_t C = shape_.channels;
  std::vector<float> part;
  const auto resampled = [&](const std::vector<float>& plane) {
    std::vector<float> rows(plane.empty() ? 0 : count * vector_.values());
    if (plane.empty()) return rows;
    if (count == measured.texels) {
      engine_.resample(plane, count, rows);
      return rows;
    }
    part.resize(shape_.images() * count * C);
    for (std::size_t i = 0; i < shape_.images(); ++i) {
      const float* from = plane.data() + (i * measured.texels + first) * C;
      std::copy(from, from + count * C, part.data() + i * count * C);
    }
    engine_.resample(part, count, rows);
    return rows;
  };
  const StageTimer timer(
      job_, "resample",
      (structural() ? 3 : 1) * static_cast<double>(count) * engine_.resampling_flops());
  Vectors vectors{resampled(measured.values), resampled(measured.means),
                  resampled(measured.deviations), std::vector<float>(count)};
  if (structural()) raise_deviations(vectors.rows, vectors.means, vectors.deviations);
  for (std::size_t p = 0; p < count; ++p) {
    vectors.scales[p] =
        mean_magnitude({vectors.rows.data() + p * vector_.values(), vector_.luminances});
  }
  return vectors;
}

double VqFitter::train(VqCodeBooks& books, const VqThresholds& thresholds) {
  const std::size_t trained = training_.texels.size();
  const auto add = [&](std::size_t first, std::size_t end, const VqThresholds& bounds) {
    for (; first < end; first += batch) {
      check_interrupt();
      const std::size_t count = std::min(batch, end - first);
      const Vectors texels = vectors(kept_, first, count);
      CountingSearch search(engine_.search());
      {
        const StageTimer timer(job_, "code-books");
        books.add(texels.view(), bounds, search);
      }
      if (!structural()) job_.stage("code-books").flops += search.flops();
      job_.advance("code-books", first + count, trained);
    }
  };
  const double luminance =
      root_mean_square(vectors(kept_, 0, std::min(batch, training_.first)).rows, vector_);
  const VqThresholds bounds = structural() ? thresholds : thresholds.times(luminance);
  add(0, training_.first, bounds);
  add(training_.first, trained, bounds.times(structural() ? second_step : std::sqrt(second_step)));
  return luminance;
}

VqCodeBook VqFitter::assign(const VqCodeBooks& books) {
  const BtfInfo& info = source_.info();
  const std::size_t texels = shape_.texels();
  const std::size_t entries_of_p4 = books.apparent_brdfs().size() / vector_.values();
  // of squared errors
  const double products =
      structural() ? 0 : 2.0 * static_cast<double>(entries_of_p4 * vector_.values());
  engine_.search().set(vector_, books.apparent_brdfs());
  std::vector<std::uint32_t> entries(texels);
  VqCodeBook p6;
  p6.scales.resize(texels);
  const std::size_t read_together = vq_read_block(info, request_);
  const std::size_t resampled_together = vq_block(info, request_);
  const auto read_from = [&](std::size_t first) {
    Measured block;
    if (first < texels) read_block(first, std::min(read_together, texels - first), block);
    return block;
  };
  // the next block is read while this one is searched for
  std::future<Measured> next = std::async(std::launch::async, read_from, std::size_t{0});
  for (std::size_t first = 0; first < texels; first += read_together) {
    const Measured block = [&] {
      const StageTimer timer(job_, "wait for texels");
      return next.get();
    }();
    const std::size_t count = block.texels;
    job_.stage("wait for texels").bytes +=
        static_cast<double>(shape_.images() * count * shape_.channels * size_of(info.dtype));
    next = std::async(std::launch::async, read_from, first + read_together);
    for (std::size_t begin = 0; begin < count; begin += resampled_together) {
      check_interrupt();
      const std::size_t here = std::min(resampled_together, count - begin);
      const Vectors found = vectors(block, begin, here);
      const StageTimer timer(job_, "texels", products * static_cast<double>(here),
                             static_cast<double>(here * vector_.values() * sizeof(float)));
      const auto nearest = engine_.search().nearest(found.view());
      const auto at = static_cast<std::ptrdiff_t>(first + begin);
      std::copy(nearest.begin(), nearest.end(), entries.begin() + at);
      std::copy(found.scales.begin(), found.scales.end(), p6.scales.begin() + at);
      job_.advance("texels", first + begin + here, texels);
    }
  }
  p6.entries = PackedIndices(std::move(entries), entries_of_p4);
  return p6;
}

namespace reference {

void decode_vq(const VqModel& model, std::size_t first, std::size_t count, std::span<double> out) {
  const BtfShape& shape = model.info.btf.shape;
  const std::size_t given = 1 + model.chromaticities;
  std::vector<double> entries(model.sizes.p4 * given);
  for (std::size_t image = 0; image < count; ++image) {
    const VqPlace place = vq_place(model.grid, model.info.btf, (first + image) / shape.lights,
                                   (first + image) % shape.lights);
    for (std::size_t j = 0; j < model.sizes.p4; ++j) {
      model.entry_values(j, place, std::span(entries).subspan(j * given, given));
    }
    double* to = out.data() + image * shape.image_values();
    for (std::size_t p = 0; p < shape.texels(); ++p) {
      const double* entry = entries.data() + model.p6.entries[p] * given;
      for (const std::uint8_t channel : model.channels) {
        *to++ = channel == 0 ? double{model.p6.scales[p]} * entry[0] : entry[channel];
      }
    }
  }
}

}  // namespace reference
}  // namespace weft
