#include "albedo_report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace weft {
namespace {

// Texels of a side that are looked at.
constexpr std::size_t most_per_side = 8;

// The middles of as many equal parts of a side.
std::vector<std::size_t> spread(std::size_t side) {
  const std::size_t count = std::min(side, most_per_side);
  std::vector<std::size_t> places;
  for (std::size_t i = 0; i < count; ++i) places.push_back((2 * i + 1) * side / (2 * count));
  return places;
}

std::vector<std::string> channel_labels(const BtfInfo& info) {
  if (!info.channel_names.empty()) return info.channel_names;
  if (info.shape.channels == 3) return {"red", "green", "blue"};
  std::vector<std::string> labels;
  for (std::size_t c = 0; c < info.shape.channels; ++c) labels.push_back(fmt::format("c{}", c));
  return labels;
}

}  // namespace

void add_albedo_table(Report& report, const BtfInfo& info, LightSampler& sampler) {
  const BtfShape& shape = info.shape;
  std::vector<LightQuery> queries;
  for (const std::size_t row : spread(shape.height)) {
    for (const std::size_t column : spread(shape.width)) {
      queries.push_back({{}, static_cast<std::uint32_t>(row * shape.width + column)});
    }
  }
  std::vector<std::string> columns{"view", "theta", "phi"};
  for (std::string& label : channel_labels(info)) columns.push_back(std::move(label));
  std::vector<std::vector<Cell>> rows;
  std::vector<float> albedos(queries.size() * shape.channels);
  for (std::size_t v = 0; v < shape.views; ++v) {
    const Direction& view = info.view_directions[v];
    for (LightQuery& query : queries) query.view = view;
    sampler.albedos(queries, albedos);
    std::vector<Cell> row{count_cell(v), number_cell(theta_degrees(view)),
                          number_cell(phi_degrees(view))};
    for (std::size_t c = 0; c < shape.channels; ++c) {
      double sum = 0;
      for (std::size_t i = 0; i < queries.size(); ++i) {
        sum += static_cast<double>(albedos[i * shape.channels + c]);
      }
      row.push_back(number_cell(sum / static_cast<double>(queries.size())));
    }
    rows.push_back(std::move(row));
  }
  report.table("albedo", std::move(columns), std::move(rows));
}

}  // namespace weft
