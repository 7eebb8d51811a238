// Multi-level vector quantisation (Havran et al. 2010, section 4.3, figure 3): nested code-books of
// luminance, the first of the fitted channels, and of chromaticity, the others (equation 4):
//
//   j = P6(x, y),  k = P3(P4(j, phi), theta)
//   L[x, y, phi, theta, alpha, beta] = c_P6 c_P4 c_P3 c_P2 P1(P2(M(k, 1), alpha), beta)
//   a[x, y, phi, theta, alpha, beta] = C(I1(I2(M(k, 2), alpha), beta))
//
//   P1 [S1, n_beta]   luminance along slices, each of mean magnitude 1
//   P2 [S2, n_alpha]  slices of a hemisphere of lights and their scales c_P2
//   M  [SM, 2]        a hemisphere of luminance and one of chromaticity
//   P3 [S3, n_theta]  hemispheres of the views of one azimuth, and scales c_P3
//   P4 [S4, n_phi]    these of all azimuths, and scales c_P4
//   P6 [P]            each texel's entry of P4, and its scale c_P6: its mean luminance
//   C  [SC, C - 1]    chromaticities;  I1 [SI1, n_beta], I2 [SI2, n_alpha]: indices
//
// The grid (phi, theta, alpha, beta) is one of two:
//
//   onion slices   see onion_slices.hpp: values between nodes are interpolated linearly in each
//                  level (figure 6), 16 of them to a value
//   measured       the directions of the data, as they are: n_phi = V, n_beta = L, the others 1
//
// Models of data of one channel have no chromaticity: no C, I1 and I2, and M is [SM, 1].
//
// Mip levels (section 5.1.3) are planar indices of their own into the same code-books: P6.level1
// [ceil(Y/2) ceil(X/2)], P6.level2 ... Code-books to which materials were added (vq_base.hpp) are
// stored in parts, P1, P1.part1 ..., each rounded by itself, so that what was there stays as it is.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "weft/btf/onion_slices.hpp"
#include "weft/btf/selection.hpp"
#include "weft/model/model.hpp"
#include "weft/model/model_file.hpp"
#include "weft/model/packed_indices.hpp"

namespace weft {

struct VqGrid {
  enum class Kind : std::uint8_t { measured, onion };
  Kind kind = Kind::measured;
  OnionSizes sizes;

  // The measured directions of a BTF.
  static VqGrid measured(const BtfShape& shape) {
    return {Kind::measured, {shape.views, 1, 1, shape.lights}};
  }

  std::size_t nodes() const { return sizes.views() * sizes.lights(); }
  bool operator==(const VqGrid&) const = default;
};

// Where a pair of directions lies: between two nodes of each of phi, theta, alpha and beta.
using VqPlace = std::array<OnionStep, 4>;

// The place of any view and light, vectors of any length above 0, in onion slices.
VqPlace vq_place(const OnionSizes& sizes, const Direction& view, const Direction& light);
// The place of view v and light l of a BTF.
VqPlace vq_place(const VqGrid& grid, const BtfInfo& btf, std::size_t view, std::size_t light);

// A code-book of rows of indices into the one below, each with a scale.
struct VqCodeBook {
  PackedIndices entries;
  std::vector<float> scales;
};

struct VqModel final : Model {
  VqGrid grid;
  // Sizes of the code-books.
  struct Sizes {
    std::size_t p1 = 0, p2 = 0, m = 0, p3 = 0, p4 = 0;
    std::size_t c = 0, i1 = 0, i2 = 0;
    bool operator==(const Sizes&) const = default;
  };
  Sizes sizes;
  std::size_t chromaticities = 0;  // C - 1 of what was fitted
  // Sizes before each addition, which are those of the parts that reals are stored in.
  std::vector<Sizes> earlier;

  std::vector<float> p1;
  VqCodeBook p2;
  PackedIndices m;
  VqCodeBook p3, p4, p6;
  std::vector<VqCodeBook> coarser;  // planar indices of mip levels from 1 on
  std::vector<float> c;
  PackedIndices i1, i2;
  // Which of the fitted channels are decoded: 0 luminance, n chromaticity n - 1.
  std::vector<std::uint8_t> channels;
  bool some_directions = false;  // views or lights were selected; not stored

  std::vector<ModelTensor> tensors() const override;
  std::vector<std::span<float>> real_values() override;
  // Throws an input error: code-books are shared among directions and texels.
  void divide(const Weights& factors) override;
  void fitted_texel(std::size_t view, std::size_t light, std::size_t y, std::size_t x,
                    std::span<double> out) const override;
  // Onion slices are of all directions, unless some views or lights were selected: what is between
  // these is then interpolated, and what is beyond them takes the nearest.
  bool takes_directions() const override {
    return grid.kind == VqGrid::Kind::onion && !some_directions;
  }
  void fitted_texel_at(const Direction& view, const Direction& light, std::size_t y, std::size_t x,
                       std::span<double> out) const override;

  // Luminance of entry `j` of P4 at a place, before c_P6, and its chromaticities: 1 +
  // chromaticities values.
  void entry_values(std::size_t j, const VqPlace& place, std::span<double> out) const;

  // The part that decodes to a selection, without code-vectors that it does not use; its mip level
  // is not looked at. It keeps the mip levels whose texels the region does not cut.
  std::unique_ptr<VqModel> select(const Selection& selection) const;

  // The first of the coarser levels as a model of its own, with the others; null where there is
  // none.
  std::unique_ptr<VqModel> next_mip_level() const;

  // A data base keeps code-books and planar indices apart: whether these tensors are there.
  bool has_code_books() const { return sizes.p4 > 0; }
  bool has_planar_index() const { return !p6.scales.empty(); }

  // From a validated file; throws an input error where the tensors do not fit each other or an
  // index is none of its code-book.
  static std::unique_ptr<VqModel> read(const ModelFile& file);

  // Keeps what tensors() gives of the sizes; to be called when all else is set.
  void seal();

 private:
  // The channels of texel p at a place.
  void texel_values(std::size_t p, const VqPlace& place, std::span<double> out) const;

  std::vector<std::byte> layout_;  // U32
};

}  // namespace weft
