// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/report/report.hpp"

namespace asbuilt {
ItemReport make_report(const ItemRecord&) { return {}; }
std::string batch_json(const std::string&, const std::vector<BatchLine>&) { return {}; }
std::string index_html(const std::string&, const std::vector<BatchLine>&) { return {}; }
}  // namespace asbuilt
