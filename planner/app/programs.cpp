// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/app/programs.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <map>
#include <tuple>

#include "planner/pipeline/store.hpp"

namespace asbuilt {

namespace {

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

struct Motion1 {
  bool is_joint = false;
  JointVector q{};
  Pose<frame::Base, frame::Tool> T;
  double speed = 0;
};

std::vector<Motion1> motions_of(const Program& p, std::size_t& others) {
  std::vector<Motion1> m;
  for (const Instruction& i : p.instructions) {
    if (const auto* j = std::get_if<MoveJoint>(&i)) m.push_back({true, j->q_rad, {}, j->speed_ratio});
    else if (const auto* l = std::get_if<MoveLinear>(&i)) m.push_back({false, {}, l->T_base_tool, l->speed_mm_s});
    else if (const auto* c = std::get_if<MoveCircular>(&i)) m.push_back({false, {}, c->T_base_via, c->speed_mm_s}), m.push_back({false, {}, c->T_base_tool, c->speed_mm_s});
    else if (const auto* c = std::get_if<MoveSpline>(&i)) m.push_back({false, {}, c->T_base_tool, c->speed_mm_s});
    else if (!std::holds_alternative<Comment>(i)) ++others;
  }
  return m;
}

}  // namespace

Result<std::vector<ReadProgram>> read_programs(const std::vector<std::string>& files, const PostContext& context) {
  std::map<std::pair<Language, std::string>, std::vector<std::filesystem::path>> groups;
  Refusals faults;
  for (const std::string& name : files) {
    const std::filesystem::path path(name);
    const std::string end = lower(path.extension().string());
    std::optional<Language> language;
    if (end == ".src" || end == ".dat") language = Language::krl;
    if (end == ".jbi" || end == ".cnd") language = Language::inform;
    if (end == ".script") language = Language::ur;
    if (end == ".nc" || end == ".cnc" || end == ".mpf")  // both Beckhoff products name their files so
      language = context.cell.controller.language == Language::nci ? Language::nci : Language::beckhoff;
    if (!language)
      faults.push_back({.code = "input.program_language", .where = name, .message = "the name tells no language; known are .src .dat (KRL), .JBI .CND (INFORM), .nc .cnc .mpf (Beckhoff), .script (UR)", .stage = "input"});
    else if (!std::filesystem::is_regular_file(path))
      faults.push_back({.code = "input.file_missing", .where = name, .message = "there is no such file", .stage = "input"});
    else
      groups[{*language, end == ".cnd" ? "" : (path.parent_path() / path.stem()).string()}].push_back(path);
  }
  // NAME_1, NAME_2, .. are modules and pages of NAME, where that is given too
  for (auto it = groups.begin(); it != groups.end();) {
    const auto& [language, stem] = it->first;
    const std::size_t at = stem.rfind('_');
    const bool is_numbered = at != std::string::npos && at + 1 < stem.size() && stem.find_first_not_of("0123456789", at + 1) == std::string::npos;
    const auto whole = is_numbered ? groups.find({language, stem.substr(0, at)}) : groups.end();
    if (whole == groups.end()) {
      ++it;
      continue;
    }
    whole->second.insert(whole->second.end(), it->second.begin(), it->second.end());
    it = groups.erase(it);
  }
  // UFRAME.CND belongs to every job beside it
  if (const auto loose = groups.find({Language::inform, ""}); loose != groups.end() && groups.size() > 1) {
    for (auto& [key, group] : groups)
      if (key.first == Language::inform && !key.second.empty()) group.insert(group.end(), loose->second.begin(), loose->second.end());
    groups.erase(loose);
  }
  if (!faults.empty()) return refuse_all(std::move(faults));
  std::vector<ReadProgram> programs;
  for (const auto& [key, group] : groups) {
    ReadProgram read;
    read.text.language = key.first;
    for (const auto& path : group) read.text.files.push_back({path.filename().string(), read_file_whole(path).value_or("")});
    const std::string main = lower(std::filesystem::path(key.second).filename().string());
    std::stable_sort(read.text.files.begin(), read.text.files.end(), [&](const ProgramFile& a, const ProgramFile& b) {  // the main program first
      const auto rank = [&](const ProgramFile& f) { return lower(f.name).ends_with(".dat") || lower(f.name).ends_with(".cnd") ? 2 : lower(std::filesystem::path(f.name).stem().string()) == main ? 0 : 1; };
      return std::tuple(rank(a), a.name.size(), lower(a.name)) < std::tuple(rank(b), b.name.size(), lower(b.name));  // _2 before _10
    });
    const Post* post = find_post(key.first);
    if (!post) return refuse({.code = "post.unknown_language", .where = group.front().string(), .message = "there is no reader for this language", .stage = "post"});
    auto program = post->read(read.text, context);
    if (!program) return refuse_all(program.error());
    read.program = std::move(*program);
    programs.push_back(std::move(read));
  }
  return programs;
}

ProgramDifference difference_of(const Program& a, const Program& b) {
  ProgramDifference d;
  const auto ma = motions_of(a, d.other_a), mb = motions_of(b, d.other_b);
  d.motions_a = ma.size(), d.motions_b = mb.size();
  for (std::size_t i = 0; i < std::min(ma.size(), mb.size()); ++i) {
    if (ma[i].is_joint != mb[i].is_joint) continue;
    if (ma[i].is_joint) {
      for (int k = 0; k < 6; ++k) d.joint_rad = std::max(d.joint_rad, std::abs(ma[i].q[k] - mb[i].q[k]));
      continue;
    }
    const double mm = (ma[i].T.p_mm - mb[i].T.p_mm).norm();
    if (mm > d.position_mm) d.position_mm = mm, d.position_at = i + 1;
    d.angle_rad = std::max(d.angle_rad, quat_log(ma[i].T.q.conjugate() * mb[i].T.q).norm());
    d.speed_mm_s = std::max(d.speed_mm_s, std::abs(ma[i].speed - mb[i].speed));
  }
  return d;
}

}  // namespace asbuilt
