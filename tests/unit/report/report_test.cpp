// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/report/report.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <limits>

#include "planner/base/archive.hpp"
#include "planner/report/json_text.hpp"
#include "planner/report/page_data.hpp"
#include "planner/report/page_html.hpp"
#include "tests/unit/report/record.hpp"

namespace asbuilt {
namespace {

Json result_of(const ItemRecord& record) { return Json::parse(make_report(record).result_json); }

TEST(Report, names_every_field_of_the_contract) {
  const Json j = result_of(test::ring_record());
  EXPECT_EQ(j.at("asbuilt"), "result/1");
  EXPECT_EQ(j.at("item"), "ring-0001");
  EXPECT_EQ(j.at("status"), "emitted");
  EXPECT_TRUE(j.at("reasons").empty());
  const Json& l = j.at("locate");
  EXPECT_EQ(l.at("base_part").at("xyz").size(), 3u);
  EXPECT_EQ(l.at("base_part").at("quat").size(), 4u);
  EXPECT_EQ(l.at("covariance").size(), 6u);
  EXPECT_TRUE(l.at("rms").is_number() && l.at("inlier_ratio").is_number());
  EXPECT_EQ(l.at("observability").at("singular_values").size(), 6u);
  EXPECT_EQ(l.at("observability").at("weak_directions").size(), 1u);
  EXPECT_EQ(l.at("hypotheses").size(), 2u);
  for (const Json& e : j.at("edges")) {
    EXPECT_EQ(e.at("frame"), "part");
    const std::size_t n = e.at("s").size();
    for (const char* field : {"nominal", "adapted", "sigma", "feed"}) EXPECT_EQ(e.at(field).size(), n) << field;
    for (const char* field : {"height", "width", "coverage"}) EXPECT_EQ(e.at("burr").at(field).size(), n) << field;
    EXPECT_EQ(e.at("nominal")[0].size(), 3u);
    EXPECT_TRUE(e.at("passes").is_number());
    for (const Json& s : e.at("surfaces")) EXPECT_TRUE(s.contains("type") && s.contains("nominal") && s.contains("fitted") && s.contains("rms") && s.contains("points"));
  }
  for (const Json& p : j.at("programs")) {
    EXPECT_TRUE(p.contains("language") && p.contains("points") && p.contains("duration_s"));
    for (const Json& f : p.at("files")) EXPECT_EQ(f.at("sha256").get<std::string>().size(), 64u);
  }
  for (const char* field : {"path_error_max", "clearance_min", "joint_margin_min", "singularity_min", "speed_ratio_max", "ok"})
    EXPECT_TRUE(j.at("verification").contains(field)) << field;
  EXPECT_NEAR(j.at("verification").at("joint_margin_min").get<double>(), deg_from_rad(0.31), 1e-3);
  for (const Json& i : j.at("inputs")) EXPECT_TRUE(i.contains("path") && i.contains("sha256"));
  EXPECT_TRUE(j.at("version").is_string());
  EXPECT_EQ(std::prev(j.end()).key(), "timing_s");
}

TEST(Report, unseen_is_null_and_never_zero) {
  const ItemRecord record = test::ring_record();
  const Json j = result_of(record);
  std::size_t unseen = 0;
  for (std::size_t k = 0; k < record.burrs->edges.size(); ++k)
    for (std::size_t i = 0; i < record.burrs->edges[k].height_mm.size(); ++i) {
      const bool is_seen = std::isfinite(record.burrs->edges[k].height_mm[i]);
      EXPECT_EQ(j["edges"][k]["burr"]["height"][i].is_null(), !is_seen);
      unseen += !is_seen;
    }
  EXPECT_GT(unseen, 5u);
}

TEST(Report, same_record_same_bytes_and_time_changes_only_timing) {
  ItemRecord a = test::ring_record(), b = test::ring_record();
  EXPECT_EQ(make_report(a).result_json, make_report(b).result_json);
  EXPECT_EQ(make_report(a).report_html, make_report(b).report_html);
  b.timing_s["fit"] = 77;
  b.peak_memory_mib["fit"] = 4096;
  Json x = result_of(a), y = result_of(b);
  EXPECT_NE(x, y);
  x.erase("timing_s"), y.erase("timing_s");
  EXPECT_EQ(readable_json(x), readable_json(y));
}

TEST(Report, a_refused_item_lists_no_programs_and_says_why_first) {
  ItemRecord record = test::refused_record();
  record.programs = test::ring_record().programs;  // written and checked, but another language failed
  const ItemReport report = make_report(record);
  const Json j = Json::parse(report.result_json);
  EXPECT_EQ(j.at("status"), "refused");
  EXPECT_TRUE(j.at("programs").empty());
  ASSERT_EQ(j.at("reasons").size(), 1u);
  const Json& r = j.at("reasons")[0];
  EXPECT_EQ(r.at("stage"), "fit");
  EXPECT_EQ(r.at("code"), "fit.edge_not_seen");
  EXPECT_EQ(r.at("value"), 34);
  EXPECT_EQ(r.at("limit"), 5);
  const std::size_t reason = report.report_html.find("was not scanned over 19.5 mm"), view = report.report_html.find("class=\"view\"");
  ASSERT_NE(reason, std::string::npos);
  EXPECT_LT(reason, view);
}

TEST(Report, holds_with_nothing_but_a_name) {
  ItemRecord record;
  record.item_id = "x<y>&\"";
  record.reasons = {{.code = "failed.signal", .message = "</script><b>ended", .stage = "fit"}};
  const ItemReport report = make_report(record);
  EXPECT_EQ(Json::parse(report.result_json).at("status"), "failed");
  EXPECT_NE(report.report_html.find("x&lt;y&gt;&amp;&quot;"), std::string::npos);
  EXPECT_EQ(report.report_html.find("</script><b>"), std::string::npos);
}

TEST(Report, page_needs_no_network) {
  const std::string html = make_report(test::ring_record()).report_html;
  for (const char* outside : {"src=", "@import", "url(http", "fetch(", "href=\"http", "XMLHttp"}) EXPECT_EQ(html.find(outside), std::string::npos) << outside;
  EXPECT_LT(html.size(), 1500000u);
}

TEST(Report, every_check_of_every_program_is_in_the_page) {
  const ItemRecord record = test::ring_record();
  const std::string html = make_report(record).report_html;
  for (const ReleasedProgram& p : record.programs)
    for (const Check& c : p.verdict.checks) EXPECT_NE(html.find("<td>" + c.name + "</td>"), std::string::npos) << c.name;
}

TEST(Report, a_failed_check_stands_out) {
  ItemRecord record = test::ring_record();
  record.status = ItemStatus::refused;
  record.programs[1].verdict.checks[0].is_passed = false;
  const std::string html = make_report(record).report_html;
  const std::size_t failed = html.find("<tr class=\"fail\"><td>path_error</td>");
  ASSERT_NE(failed, std::string::npos);
  EXPECT_FALSE(result_of(record).at("verification").at("ok").get<bool>());
}

TEST(Report, thinned_mesh_keeps_its_shape) {
  Mesh mesh;
  const int n = 220;
  for (int i = 0; i <= n; ++i)
    for (int k = 0; k <= n; ++k) mesh.vertices.push_back({double(i), double(k), 0});
  for (int i = 0; i < n; ++i)
    for (int k = 0; k < n; ++k) {
      const int a = i * (n + 1) + k;
      mesh.triangles.push_back({a, a + n + 1, a + 1}), mesh.triangles.push_back({a + 1, a + n + 1, a + n + 2});
    }
  const Mesh small = thinned(mesh, 20000);
  EXPECT_LE(small.triangles.size(), 20000u);
  double area = 0;
  for (const auto& t : small.triangles) area += 0.5 * (small.vertices[t[1]] - small.vertices[t[0]]).cross(small.vertices[t[2]] - small.vertices[t[0]]).z();
  EXPECT_NEAR(area, double(n) * n, 0.03 * n * n);
  EXPECT_EQ(thinned(mesh, 1000000).triangles.size(), mesh.triangles.size());
}

TEST(Report, edges_named_in_the_reason_are_marked_and_no_others) {
  ItemRecord record = test::refused_record();
  std::vector<BrepEdge>& edges = record.job->part.brep.edges;
  edges[0].id = "#10", edges[1].id = "#103", edges[2].id = "#41", edges[3].id = "#419";
  record.job->part.features = {{"lug1", "deburr-0.4", {0, 1}}, {"lug3", "deburr-0.4", {2, 3}}};
  record.reasons[0].where = "edge #419 of lug3, and #103";
  const Json wanted = page_data(record).at("wanted");
  ASSERT_EQ(wanted.size(), 4u);
  for (const Json& e : wanted) EXPECT_EQ(e.at("blamed").get<bool>(), e.at("id") == "#103" || e.at("id") == "#419") << e.at("id");
  EXPECT_FALSE(page_data(test::ring_record()).contains("wanted"));
}

TEST(Report, base64_as_in_rfc_4648) {
  EXPECT_EQ(base64(""), "");
  EXPECT_EQ(base64("f"), "Zg==");
  EXPECT_EQ(base64("fo"), "Zm8=");
  EXPECT_EQ(base64("foo"), "Zm9v");
  EXPECT_EQ(base64("foobar"), "Zm9vYmFy");
}

TEST(Report, json_text_is_json_without_minus_zero_or_nan) {
  Json j;
  j["a"] = Json::array({number(-0.00001, 3), number(std::numeric_limits<double>::quiet_NaN(), 3), 1.5});
  j["text"] = "line\n\"quoted\" \xc3\xa4";
  j["b"] = significant(123456.789, 4);
  j["c"] = significant(0.000123456, 3);
  const std::string text = readable_json(j);
  EXPECT_EQ(Json::parse(text), Json::parse(compact_json(j)));
  EXPECT_NE(text.find("[0, null, 1.5]"), std::string::npos) << text;
  EXPECT_EQ(Json::parse(text)["b"].get<double>(), 123500);
  EXPECT_EQ(Json::parse(text)["c"].get<double>(), 0.000123);
  EXPECT_EQ(Json::parse(text)["text"], j["text"]);
}

TEST(Report, batch_counts_and_puts_faults_first) {
  BatchLine good{"ring-0001", ItemStatus::emitted, {}, {{"fit", 1.5}}, {}, make_report(test::ring_record()).result_json};
  BatchLine bad{"ring-0002", ItemStatus::refused, test::refused_record().reasons, {}, {}, make_report(test::refused_record()).result_json};
  const Json j = Json::parse(batch_json("night", {good, bad}));
  EXPECT_EQ(j.at("items").size(), 2u);
  EXPECT_EQ(j.at("emitted"), 1);
  EXPECT_EQ(j.at("refused"), 1);
  EXPECT_EQ(j.at("items")[1].at("reasons")[0].at("code"), "fit.edge_not_seen");
  const std::string html = index_html("night", {good, bad});
  EXPECT_LT(html.find("ring-0002/report.html"), html.find("ring-0001/report.html"));
}

// Pages to look at: REPORT_PAGES=folder test_report --gtest_filter=*pages_to_look_at*
TEST(Report, pages_to_look_at) {
  const char* folder = std::getenv("REPORT_PAGES");
  if (!folder) GTEST_SKIP() << "REPORT_PAGES names no folder";
  const auto write = [&](const char* name, const std::string& text) { std::ofstream(std::string(folder) + "/" + name, std::ios::binary) << text; };
  write("emitted.html", make_report(test::ring_record()).report_html);
  write("refused.html", make_report(test::refused_record()).report_html);
  BatchLine good{"ring-0001", ItemStatus::emitted, {}, {{"fit", 1.5}}, {}, make_report(test::ring_record()).result_json};
  BatchLine bad{"ring-0002", ItemStatus::refused, test::refused_record().reasons, {}, {}, make_report(test::refused_record()).result_json};
  BatchLine worse{"ring-0003", ItemStatus::failed, {{.code = "failed.signal", .message = "the item's process was ended in stage fit by signal 11 (Segmentation fault); the other items went on", .stage = "fit"}}, {}, {}, ""};
  write("index.html", index_html("night-2026-11-22", {good, bad, worse}));
}

}  // namespace
}  // namespace asbuilt
