#include "weft/reference/patch_synthesis.hpp"

#include <algorithm>
#include <limits>

#include "weft/error.hpp"
#include "weft/reference/random.hpp"

namespace weft::reference {
namespace {

// A position of a piece of the source, its upper left texel.
struct Piece {
  std::size_t y = 0;
  std::size_t x = 0;
};

class Quilt {
 public:
  Quilt(std::size_t source_height, std::size_t source_width, std::span<const float> features,
        const PatchRequest& request)
      : source_height_(source_height),
        source_width_(source_width),
        features_(features),
        count_(features.size() / (source_height * source_width)),
        request_(request),
        texels_(request.height * request.width) {}

  std::vector<std::size_t> make() {
    const std::size_t step = request_.patch - request_.overlap;
    for (std::size_t y = 0; y == 0 || y + request_.overlap < request_.height; y += step) {
      for (std::size_t x = 0; x == 0 || x + request_.overlap < request_.width; x += step) {
        check_interrupt();
        lay(y, x, x == 0 && y == 0 ? random_piece() : best_piece(y, x));
      }
    }
    return std::move(texels_);
  }

 private:
  std::size_t random_below(std::size_t limit) {
    return static_cast<std::size_t>(splitmix64(request_.seed, drawn_++) % limit);
  }
  Piece random_piece() {
    const std::size_t y = random_below(source_height_ - request_.patch + 1);
    return {y, random_below(source_width_ - request_.patch + 1)};
  }

  double difference(std::size_t a, std::size_t b) const {
    const float* one = features_.data() + a * count_;
    const float* other = features_.data() + b * count_;
    float sum = 0;
    for (std::size_t i = 0; i < count_; ++i) sum += (one[i] - other[i]) * (one[i] - other[i]);
    return double{sum};
  }
  std::size_t source_texel(const Piece& piece, std::size_t y, std::size_t x) const {
    return (piece.y + y) * source_width_ + piece.x + x;
  }
  // Rows and columns of a patch that are within the image.
  std::size_t rows(std::size_t y) const { return std::min(request_.patch, request_.height - y); }
  std::size_t columns(std::size_t x) const { return std::min(request_.patch, request_.width - x); }

  // Of a piece from what the patches before left under it; stops beyond `most`.
  double overlap_difference(std::size_t y0, std::size_t x0, const Piece& piece, double most) const {
    double sum = 0;
    const std::size_t left = x0 > 0 ? request_.overlap : 0;
    for (std::size_t y = 0; y < rows(y0) && sum <= most; ++y) {
      const std::size_t end =
          y0 > 0 && y < request_.overlap ? columns(x0) : std::min(left, columns(x0));
      for (std::size_t x = 0; x < end; ++x) {
        sum += difference(texels_[(y0 + y) * request_.width + x0 + x], source_texel(piece, y, x));
      }
    }
    return sum;
  }

  Piece best_piece(std::size_t y0, std::size_t x0) {
    std::vector<Piece> pieces(request_.pieces);
    std::vector<double> differences;
    double least = std::numeric_limits<double>::infinity();
    for (Piece& piece : pieces) {
      piece = random_piece();
      const double most = least * (1 + request_.tolerance);
      differences.push_back(overlap_difference(y0, x0, piece, most));
      least = std::min(least, differences.back());
    }
    std::vector<Piece> good;
    for (std::size_t i = 0; i < pieces.size(); ++i) {
      if (differences[i] <= least * (1 + request_.tolerance)) good.push_back(pieces[i]);
    }
    return good[random_below(good.size())];
  }

  // For each of `length` steps along an overlap, the place across it where the border is: the path
  // of the least sum of costs [length][overlap], by at most one place a step.
  std::vector<std::size_t> cheapest_path(std::vector<double> costs, std::size_t length) const {
    const std::size_t across = request_.overlap;
    for (std::size_t i = 1; i < length; ++i) {
      for (std::size_t k = 0; k < across; ++k) {
        const double* before = costs.data() + (i - 1) * across;
        const std::size_t low = k > 0 ? k - 1 : 0;
        const std::size_t high = std::min(k + 1, across - 1);
        costs[i * across + k] += *std::min_element(before + low, before + high + 1);
      }
    }
    std::vector<std::size_t> path(length);
    std::size_t low = 0;
    std::size_t high = across;
    for (std::size_t i = length; i-- > 0;) {
      const double* row = costs.data() + i * across;
      path[i] = static_cast<std::size_t>(std::min_element(row + low, row + high) - row);
      low = path[i] > 0 ? path[i] - 1 : 0;
      high = std::min(path[i] + 2, across);
    }
    return path;
  }

  void lay(std::size_t y0, std::size_t x0, const Piece& piece) {
    const std::size_t overlap = request_.overlap;
    const auto cost = [&](std::size_t y, std::size_t x) {
      return difference(texels_[(y0 + y) * request_.width + x0 + x], source_texel(piece, y, x));
    };
    // the first column and row that are the new patch's
    std::vector<std::size_t> first_column(rows(y0), 0), first_row(columns(x0), 0);
    if (x0 > 0 && overlap > 0) {
      std::vector<double> costs(rows(y0) * overlap, 0.0);
      for (std::size_t i = 0; i < costs.size(); ++i) {
        if (i % overlap < columns(x0)) costs[i] = cost(i / overlap, i % overlap);
      }
      first_column = cheapest_path(std::move(costs), rows(y0));
    }
    if (y0 > 0 && overlap > 0) {
      std::vector<double> costs(columns(x0) * overlap, 0.0);
      for (std::size_t i = 0; i < costs.size(); ++i) {
        if (i % overlap < rows(y0)) costs[i] = cost(i % overlap, i / overlap);
      }
      first_row = cheapest_path(std::move(costs), columns(x0));
    }
    for (std::size_t y = 0; y < rows(y0); ++y) {
      for (std::size_t x = 0; x < columns(x0); ++x) {
        if (x < first_column[y] || y < first_row[x]) continue;
        texels_[(y0 + y) * request_.width + x0 + x] = source_texel(piece, y, x);
      }
    }
  }

  std::size_t source_height_;
  std::size_t source_width_;
  std::span<const float> features_;
  std::size_t count_;
  const PatchRequest& request_;
  std::vector<std::size_t> texels_;
  std::uint64_t drawn_ = 0;
};

}  // namespace

PatchRequest patch_request(std::size_t source_height, std::size_t source_width) {
  const std::size_t shorter = std::min(source_height, source_width);
  PatchRequest request;
  request.patch = std::min(std::clamp<std::size_t>(shorter / 4, 4, 32), shorter);
  request.overlap = request.patch / 4;
  return request;
}

std::vector<std::size_t> synthesise_patches(std::size_t source_height, std::size_t source_width,
                                            std::span<const float> features,
                                            const PatchRequest& request) {
  if (request.height == 0 || request.width == 0) {
    fail_input("a texture of {} x {} texels is none", request.width, request.height);
  }
  if (request.patch == 0 || request.patch > std::min(source_height, source_width)) {
    fail_input("patches of {} texels: 1 to {} are needed of a source of {} x {}", request.patch,
               std::min(source_height, source_width), source_width, source_height);
  }
  if (2 * request.overlap >= request.patch && request.patch > 1) {
    fail_input("an overlap of {} texels: less than half of a patch of {} is needed",
               request.overlap, request.patch);
  }
  if (request.patch == 1 && request.overlap > 0) {
    fail_input("an overlap of {} texels of patches of 1", request.overlap);
  }
  if (request.pieces == 0) fail_input("no pieces of the source to choose from");
  return Quilt(source_height, source_width, features, request).make();
}

}  // namespace weft::reference
