// SPDX-License-Identifier: GPL-3.0-or-later
// compare: the drawing against the adapted edge (one result), two results of one item point by point, or two programs move by move.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "planner/app/commands.hpp"
#include "planner/app/programs.hpp"
#include "planner/base/number.hpp"
#include "planner/pipeline/store.hpp"

namespace asbuilt {

namespace {

namespace fs = std::filesystem;

std::vector<Vec3> line_of(const Json& a) {
  std::vector<Vec3> p;
  for (const Json& v : a) p.emplace_back(v.at(0).get<double>(), v.at(1).get<double>(), v.at(2).get<double>());
  return p;
}

/// Distance of every point from the other polyline, and where the greatest is (index).
struct Apart {
  double mean_mm = 0, p95_mm = 0, max_mm = 0;
  std::size_t at = 0;
  std::vector<double> each_mm;
};
Apart apart(const std::vector<Vec3>& from, const std::vector<Vec3>& to, bool is_pairwise) {
  Apart a;
  for (std::size_t i = 0; i < from.size(); ++i) {
    double d = 1e300;
    if (is_pairwise && from.size() == to.size()) {
      d = (from[i] - to[i]).norm();
    } else if (to.size() == 1) {
      d = (from[i] - to[0]).norm();
    } else {
      for (std::size_t k = 0; k + 1 < to.size(); ++k) {
        const Vec3 e = to[k + 1] - to[k];
        d = std::min(d, (from[i] - to[k] - e * std::clamp((from[i] - to[k]).dot(e) / std::max(1e-15, e.squaredNorm()), 0.0, 1.0)).norm());
      }
    }
    a.each_mm.push_back(d);
    if (d > a.max_mm) a.max_mm = d, a.at = i;
    a.mean_mm += d / static_cast<double>(from.size());
  }
  std::vector<double> sorted = a.each_mm;
  std::sort(sorted.begin(), sorted.end());
  if (!sorted.empty()) a.p95_mm = sorted[std::min(sorted.size() - 1, static_cast<std::size_t>(0.95 * static_cast<double>(sorted.size())))];
  return a;
}

Json rounded_list(const std::vector<double>& v) {
  Json a = Json::array();
  for (const double x : v) a.push_back(rounded(x, 5));
  return a;
}

double greatest_difference(const Json& a, const Json& b) {  // of two arrays of numbers, where both were seen
  double m = 0;
  if (a.is_array() && b.is_array())
    for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i)
      if (a[i].is_number() && b[i].is_number()) m = std::max(m, std::abs(a[i].get<double>() - b[i].get<double>()));
  return m;
}

Pose<frame::Base, frame::Part> pose_of(const Json& result) {
  const Json& b = result.at("locate").at("base_part");
  const Json &q = b.at("quat"), &p = b.at("xyz");
  return {Eigen::Quaterniond(q[0].get<double>(), q[1].get<double>(), q[2].get<double>(), q[3].get<double>()).normalized(), Vec3(p[0].get<double>(), p[1].get<double>(), p[2].get<double>())};
}

struct Compared {
  Json json;
  std::string text;
};

Compared against_drawing(const Json& r) {
  Compared c{{{"asbuilt", "compare/1"}, {"kind", "nominal-adapted"}, {"item", r.at("item")}, {"edges", Json::array()}}, ""};
  std::vector<std::vector<std::string>> rows{{"edge", "feature", "mean mm", "p95 mm", "max mm", "at mm", "rigid", "feature", "local (max mm)"}};
  for (const Json& e : r.at("edges")) {
    const Apart d = apart(line_of(e.at("adapted")), line_of(e.at("nominal")), true);
    const double at = e.at("s").empty() ? 0 : e.at("s")[d.at].get<double>();
    std::vector<std::string> row{e.at("id"), e.at("feature"), fmt::format("{:.4f}", d.mean_mm), fmt::format("{:.4f}", d.p95_mm), fmt::format("{:.4f}", d.max_mm), fmt::format("{:.1f}", at)};
    Json edge{{"id", e.at("id")}, {"feature", e.at("feature")}, {"mean", rounded(d.mean_mm, 5)}, {"p95", rounded(d.p95_mm, 5)}, {"max", rounded(d.max_mm, 5)}, {"at", at}};
    edge["s"] = e.at("s");
    edge["deviation"] = rounded_list(d.each_mm);
    for (const char* part : {"rigid", "feature", "local"}) {
      double m = 0;
      if (e.contains("change"))
        for (const Json& v : e["change"][part])
          if (v.is_number()) m = std::max(m, std::abs(v.get<double>()));
      row.push_back(fmt::format("{:.4f}", m));
    }
    if (e.contains("change")) edge["change"] = e["change"];
    rows.push_back(std::move(row));
    c.json["edges"].push_back(std::move(edge));
  }
  c.text = text_table(rows);
  return c;
}

Compared two_runs(const Json& a, const Json& b) {
  Compared c{{{"asbuilt", "compare/1"}, {"kind", "two-runs"}, {"items", {a.at("item"), b.at("item")}}, {"status", {a.at("status"), b.at("status")}}, {"edges", Json::array()}}, ""};
  c.text = fmt::format("{}: {}; {}: {}\n", a.at("item").get<std::string>(), a.at("status").get<std::string>(), b.at("item").get<std::string>(), b.at("status").get<std::string>());
  if (a.contains("locate") && b.contains("locate")) {
    const Vec6 twist = twist_between(pose_of(a), pose_of(b));
    c.json["base_part"] = {{"mm", rounded(twist.head<3>().norm(), 5)}, {"deg", rounded(deg_from_rad(twist.tail<3>().norm()), 6)}};
    c.text += fmt::format("part in base: {:.4f} mm, {:.5f} deg apart\n", twist.head<3>().norm(), deg_from_rad(twist.tail<3>().norm()));
  }
  std::vector<std::vector<std::string>> rows{{"edge", "feature", "mean mm", "p95 mm", "max mm", "at mm", "burr mm", "feed mm/s"}};
  for (const Json& e : a.at("edges")) {
    const auto other = std::find_if(b.at("edges").begin(), b.at("edges").end(), [&](const Json& f) { return f.at("id") == e.at("id") && f.at("feature") == e.at("feature"); });
    if (other == b.at("edges").end()) {
      rows.push_back({e.at("id"), e.at("feature"), "only in the first"});
      c.json["edges"].push_back({{"id", e.at("id")}, {"feature", e.at("feature")}, {"only_in", "a"}});
      continue;
    }
    const bool is_same_stations = e.at("s") == other->at("s");
    const Apart d = apart(line_of(e.at("adapted")), line_of(other->at("adapted")), is_same_stations);
    const double at = e.at("s").empty() ? 0 : e.at("s")[d.at].get<double>();
    const double burr = e.contains("burr") && other->contains("burr") ? greatest_difference(e["burr"]["height"], (*other)["burr"]["height"]) : 0;
    const double feed = e.contains("feed") && other->contains("feed") ? greatest_difference(e["feed"], (*other)["feed"]) : 0;
    rows.push_back({e.at("id"), e.at("feature"), fmt::format("{:.4f}", d.mean_mm), fmt::format("{:.4f}", d.p95_mm), fmt::format("{:.4f}", d.max_mm), fmt::format("{:.1f}", at), fmt::format("{:.3f}", burr),
                    fmt::format("{:.2f}", feed)});
    c.json["edges"].push_back({{"id", e.at("id")}, {"feature", e.at("feature")}, {"mean", rounded(d.mean_mm, 5)}, {"p95", rounded(d.p95_mm, 5)}, {"max", rounded(d.max_mm, 5)}, {"at", at},
                               {"burr_max", rounded(burr, 5)}, {"feed_max", rounded(feed, 5)}, {"s", e.at("s")}, {"distance", rounded_list(d.each_mm)}});
  }
  for (const Json& e : b.at("edges"))
    if (std::none_of(a.at("edges").begin(), a.at("edges").end(), [&](const Json& f) { return f.at("id") == e.at("id") && f.at("feature") == e.at("feature"); }))
      rows.push_back({e.at("id"), e.at("feature"), "only in the second"});
  c.text += text_table(rows);
  return c;
}

bool is_program(const fs::path& file) {
  std::string end = file.extension().string();
  std::transform(end.begin(), end.end(), end.begin(), [](unsigned char ch) { return static_cast<char>(std::tolower(ch)); });
  return end == ".src" || end == ".jbi" || end == ".nc" || end == ".cnc" || end == ".mpf";
}

int compare_programs_command(const CompareArguments& a, Console& console) {
  if (a.cell.empty()) return console.complain("compare of programs needs --cell cell.yaml: tools, frames and units of the controller decide what a program means"), 2;
  const auto cell = calibrated_cell(a.cell, a.calibration, console);
  if (!cell) return console.complain(cell.error()), 2;
  const PostContext context{*cell, today_iso()};
  std::vector<Program> programs;
  for (const std::string& file : {a.a, a.b}) {
    std::vector<std::string> files{file};
    for (const char* end : {".dat", ".DAT"})
      if (const fs::path beside = fs::path(file).replace_extension(end); fs::exists(beside)) files.push_back(beside.string());
    if (const fs::path beside = fs::path(file).parent_path() / "UFRAME.CND"; fs::exists(beside)) files.push_back(beside.string());
    auto read = read_programs(files, context);
    if (!read) return console.complain(read.error()), 2;
    programs.push_back(std::move(read->front().program));
  }
  const ProgramDifference d = difference_of(programs[0], programs[1]);
  const Json json{{"asbuilt", "compare/1"}, {"kind", "programs"}, {"motions", {d.motions_a, d.motions_b}}, {"other", {d.other_a, d.other_b}}, {"position_mm", rounded(d.position_mm, 6)},
                  {"position_at_motion", d.position_at}, {"angle_deg", rounded(deg_from_rad(d.angle_rad), 6)}, {"joint_deg", rounded(deg_from_rad(d.joint_rad), 6)}, {"speed_mm_s", rounded(d.speed_mm_s, 6)}};
  console.answer(json, fmt::format("motions: {} and {}; other instructions: {} and {}\ngreatest difference of motions at the same place: {:.4f} mm (motion {}), {:.5f} deg of the tool, {:.5f} deg of a joint, {:.3f} mm/s\n",
                                   d.motions_a, d.motions_b, d.other_a, d.other_b, d.position_mm, d.position_at, deg_from_rad(d.angle_rad), deg_from_rad(d.joint_rad), d.speed_mm_s));
  return 0;
}

}  // namespace

int compare_command(const CompareArguments& a, Console& console) {
  if (is_program(a.a) && is_program(a.b)) return compare_programs_command(a, console);
  std::vector<Json> results;
  for (const std::string& name : {a.a, a.b}) {
    if (name.empty()) continue;
    const fs::path file = fs::is_directory(name) ? fs::path(name) / "result.json" : fs::path(name);
    const auto text = read_file_whole(file);
    if (!text) return console.complain(file.string() + ": there is no such file; compare takes result.json, the folder of one, or two programs"), 2;
    Json j = Json::parse(*text, nullptr, false);
    if (!j.is_object() || j.value("asbuilt", "") != "result/1") return console.complain(file.string() + ": found no result/1 of asbuilt"), 2;
    results.push_back(std::move(j));
  }
  try {
    const Compared c = results.size() == 1 ? against_drawing(results[0]) : two_runs(results[0], results[1]);
    console.answer(c.json, c.text);
  } catch (const Json::exception& fault) {
    return console.complain(std::string("a result lacks a field of the contract: ") + fault.what()), 2;
  }
  return 0;
}

}  // namespace asbuilt
