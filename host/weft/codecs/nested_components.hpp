// Nested models of the codecs that keep principal components: of one basis, of one per view, or of
// one per cluster. Components are taken in the order of what they add for the room they take; those
// of one basis in the order of their singular values.
//
//   |T - T_i|^2 = |T - T'|^2 + sum of |B_j|^2 over components j of T' that T_i has not,
//
// since the columns of A are orthonormal within a basis.
#pragma once

#include <memory>
#include <string>

#include "weft/codecs/nested_models.hpp"
#include "weft/model/lpca.hpp"
#include "weft/model/pca.hpp"
#include "weft/model/view_pca.hpp"

namespace weft {

// What is known of the whole model's error, and why no decomposition has more components; empty
// where another may.
struct NestedWhole {
  double squares = 0;           // |T|^2
  double residual_squares = 0;  // |T - T'|^2
  std::string bound;
};

// The whole model is unrounded, its info complete but for selection and errors; `kept` in its
// parameters becomes what each part keeps.
std::unique_ptr<NestedModels> nested_components(std::unique_ptr<PcaModel> whole,
                                                const NestedWhole& about);
std::unique_ptr<NestedModels> nested_components(std::unique_ptr<ViewPcaModel> whole,
                                                const NestedWhole& about);
// Its spectra are one list: the squared error with j components of every cluster, from none on.
std::unique_ptr<NestedModels> nested_components(std::unique_ptr<LpcaModel> whole,
                                                const NestedWhole& about);

// The first components of each basis: `ranks` has one number for each, no more than the whole has.
std::unique_ptr<PcaModel> leading_components(const PcaModel& whole, std::size_t rank);
std::unique_ptr<ViewPcaModel> leading_components(const ViewPcaModel& whole,
                                                 const std::vector<std::uint32_t>& ranks);
std::unique_ptr<LpcaModel> leading_components(const LpcaModel& whole,
                                              const std::vector<std::uint32_t>& ranks);

}  // namespace weft
