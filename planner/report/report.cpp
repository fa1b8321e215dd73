// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/report/report.hpp"

#include "planner/report/json_text.hpp"
#include "planner/report/page_html.hpp"
#include "planner/report/result_json.hpp"

namespace asbuilt {

ItemReport make_report(const ItemRecord& record) { return {readable_json(result_document(record)), report_page(record)}; }

}  // namespace asbuilt
