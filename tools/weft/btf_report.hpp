// Fields of BTFs and their errors, which several subcommands report in the same way.
#pragma once

#include "report.hpp"

namespace weft {

struct BtfInfo;
struct ErrorReport;
struct WeightedErrorReport;

void add_btf_fields(Report& report, const BtfInfo& info);
void add_error_fields(Report& report, const ErrorReport& errors);
void add_weighted_fields(Report& report, const WeightedErrorReport& errors);

}  // namespace weft
