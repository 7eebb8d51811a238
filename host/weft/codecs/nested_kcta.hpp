// Nested models of the codecs `cta` and `kcta` (Tsai & Shih 2012): of one fit, leading parts of the
// cores and of the bases.
//
// Bases and mixing matrices U_n,c are orthonormal, so that of one cluster
//
//   |Z_c x_1 U_1,c ... x_N U_N,c - its leading part|^2 = |Z_c|^2 - |leading part of Z_c|^2
//
// and with one mixture cluster for each slice that is what the whole loses; with several, the
// products of different clusters' losses are beside it. Cores are turned into all-orthogonal ones
// first (De Lathauwer et al. 2000), whose slices are in the order of their norms; a mode that is
// kept whole takes a basis when it is cut. Ranks are given up in the order of what that loses for
// the numbers it saves, all clusters alike, for each rank of the clustered mode.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "weft/codecs/nested_models.hpp"
#include "weft/reference/kcta.hpp"

namespace weft {

struct NestedClusters {
  KctaFit fit;  // unrounded, its model's info complete but for selection and errors
  std::vector<std::uint8_t> global;  // whether a mode has one basis for all clusters
  std::size_t align = 1;             // ranks are multiples of it, or all that there are
  std::string bound;                 // why no other fit is more accurate; empty where one may be
  std::size_t decompositions = 1;    // fits that it took
  std::shared_ptr<const ModeSpectra> spectra;  // that a further fit takes over
  // A model's parameters, of its relative error as foreseen.
  std::function<std::string(const KctaModel& model, double error)> parameters;
};

std::unique_ptr<NestedModels> nested_clusters(NestedClusters clusters);

// Numbers in the model of a request, about: its cores, bases and mixing matrices.
double clustered_numbers(const KctaRequest& request);

}  // namespace weft
