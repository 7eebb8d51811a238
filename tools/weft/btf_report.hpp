// Fields of BTFs and their errors, which several subcommands report in the same way.
#pragma once

#include "report.hpp"

namespace weft {

struct BtfInfo;
struct ErrorReport;
struct ModelInfo;
struct WeightedErrorReport;

void add_btf_fields(Report& report, const BtfInfo& info);
// Of a model, which has a mask where a model of one stands for it, too.
void add_btf_fields(Report& report, const ModelInfo& info);
void add_error_fields(Report& report, const ErrorReport& errors);
void add_weighted_fields(Report& report, const WeightedErrorReport& errors);

}  // namespace weft
