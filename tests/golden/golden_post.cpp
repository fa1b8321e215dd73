// SPDX-License-Identifier: GPL-3.0-or-later
// One golden case of a post: a hand-written neutral program in, bytes out, no numerics in between.
//
//   golden_post CASE_FOLDER ACTUAL_FOLDER
//
// case.yaml      language, and what differs from the test cell: options, orientation, speed_unit, refuse (a code)
// program.yaml   the neutral program: mm, degrees, mm/s; poses in base, or `in: work` for the frame set before
// expected.NAME  one for each emitted file, or expected.refusal
// skip, xfail    with the reason inside
// Where the text differs the test also says what changed for the robot: motions, millimetres, degrees, millimetres per second.
#include <yaml-cpp/yaml.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <sstream>

#include "planner/base/number.hpp"
#include "tests/support/post_programs.hpp"

namespace fs = std::filesystem;
using namespace asbuilt;

namespace {

std::string slurp(const fs::path& p) {
  std::ostringstream s;
  s << std::ifstream(p, std::ios::binary).rdbuf();
  return s.str();
}
void spit(const fs::path& p, const std::string& bytes) {
  fs::create_directories(p.parent_path());
  std::ofstream(p, std::ios::binary) << bytes;
}

template <class To>
Pose<frame::Base, To> pose_of(const YAML::Node& n, const Pose<frame::Base, frame::Work>& T_base_work) {
  const auto v = n["xyz"].as<std::vector<double>>(), a = n["zyx"].as<std::vector<double>>(std::vector<double>{0, 0, 0});
  const Pose<frame::Work, To> T(quat_from_zyx(rad_from_deg(a.at(0)), rad_from_deg(a.at(1)), rad_from_deg(a.at(2))), Vec3(v.at(0), v.at(1), v.at(2)));
  if (n["in"]) return T_base_work * T;
  return Pose<frame::Base, To>(T.q, T.p_mm);
}

Program program_of(const YAML::Node& n, const PostContext& context) {
  Program p;
  p.name = n["name"].as<std::string>();
  p.header = n["header"].as<std::vector<std::string>>(std::vector<std::string>{});
  Pose<frame::Base, frame::Work> T_base_work;
  for (const YAML::Node& i : n["instructions"]) {
    const double blend = i["blend"].as<double>(0), speed = i["speed"].as<double>(0);
    const int repeat = i["repeat"].as<int>(1);
    for (int k = 0; k < repeat; ++k) {
      if (i["tool"]) {
        for (const ToolSpec& t : context.cell.tools)
          if (t.number == i["tool"].as<int>()) p.instructions.emplace_back(SetTool{t.number, t.T_flange_tool});
      } else if (i["frame"]) {
        T_base_work = pose_of<frame::Work>(i["frame"], {});
        p.instructions.emplace_back(SetFrame{T_base_work});
      } else if (i["joint"]) {
        MoveJoint m;
        const auto q = i["joint"].as<std::vector<double>>();
        for (int j = 0; j < 6; ++j) m.q_rad[j] = rad_from_deg(q.at(j));
        m.speed_ratio = speed;
        p.instructions.emplace_back(m);
      } else if (i["line"]) {
        p.instructions.emplace_back(MoveLinear{pose_of<frame::Tool>(i["line"], T_base_work), speed, blend == 0, blend});
      } else if (i["arc"]) {
        p.instructions.emplace_back(
            MoveCircular{pose_of<frame::Tool>(i["via"], T_base_work), pose_of<frame::Tool>(i["arc"], T_base_work), speed, blend == 0, blend});
      } else if (i["spindle"]) {
        if (i["spindle"].as<std::string>() == "off")
          p.instructions.emplace_back(SpindleOff{});
        else
          p.instructions.emplace_back(SpindleOn{i["spindle"].as<double>()});
      } else if (i["output"]) {
        p.instructions.emplace_back(SetOutput{i["output"].as<int>(), i["value"].as<bool>()});
      } else if (i["spline"]) {
        p.instructions.emplace_back(MoveSpline{pose_of<frame::Tool>(i["spline"], T_base_work), speed});
      } else if (i["output_at"]) {
        p.instructions.emplace_back(OutputOnPath{i["output_at"].as<int>(), i["value"].as<bool>(), i["path"].as<double>()});
      } else if (i["on"] || i["off"]) {
        const std::string what = i[i["on"] ? "on" : "off"].as<std::string>();
        for (const Equipment e : {Equipment::coolant, Equipment::arc, Equipment::weave, Equipment::recording, Equipment::tool_check}) {
          if (name_of(e) != what) continue;
          if (i["on"]) p.instructions.emplace_back(SwitchOn{e, i["data"].as<int>(0)});
          else p.instructions.emplace_back(SwitchOff{e, i["data"].as<int>(0)});
        }
      } else if (i["wait"]) {
        p.instructions.emplace_back(Wait{i["wait"].as<double>()});
      } else {
        p.instructions.emplace_back(Comment{i["comment"].as<std::string>()});
      }
    }
  }
  return p;
}

/// What a change of text means for the robot.
std::string in_physical_words(const Post& post, const ProgramText& was, const ProgramText& is, const PostContext& context) {
  const auto a = post.read(was, context), b = post.read(is, context);
  if (!a) return "the expected text cannot be read: " + support::text_of(a.error());
  if (!b) return "the new text cannot be read: " + support::text_of(b.error());
  double mm = 0, deg = 0, mm_s = 0, joint_deg = 0;
  std::vector<const Instruction*> ma, mb;
  const auto moves = [](const Program& p, std::vector<const Instruction*>& out) {
    for (const Instruction& i : p.instructions)
      if (std::holds_alternative<MoveJoint>(i) || std::holds_alternative<MoveLinear>(i) || std::holds_alternative<MoveCircular>(i)) out.push_back(&i);
  };
  moves(*a, ma), moves(*b, mb);
  int other = 0;
  for (std::size_t i = 0; i < std::min(ma.size(), mb.size()); ++i) {
    if (ma[i]->index() != mb[i]->index()) {
      ++other;
    } else if (const auto* l = std::get_if<MoveLinear>(ma[i])) {
      const auto& r = std::get<MoveLinear>(*mb[i]);
      mm = std::max(mm, (l->T_base_tool.p_mm - r.T_base_tool.p_mm).norm());
      deg = std::max(deg, deg_from_rad(quat_log(l->T_base_tool.q.conjugate() * r.T_base_tool.q).norm()));
      mm_s = std::max(mm_s, std::abs(l->speed_mm_s - r.speed_mm_s));
    } else if (const auto* j = std::get_if<MoveJoint>(ma[i])) {
      for (int k = 0; k < 6; ++k) joint_deg = std::max(joint_deg, deg_from_rad(std::abs(j->q_rad[k] - std::get<MoveJoint>(*mb[i]).q_rad[k])));
    }
  }
  return std::to_string(ma.size()) + " motions before, " + std::to_string(mb.size()) + " now, " + std::to_string(other) + " of another kind; largest change " +
         fixed_number(mm, 4) + " mm, " + fixed_number(deg, 4) + " deg, " + fixed_number(mm_s, 4) + " mm/s, joints " + fixed_number(joint_deg, 4) + " deg";
}

int run(const fs::path& folder, const fs::path& actual) {
  const std::string name = "golden." + folder.parent_path().filename().string() + "." + folder.filename().string();
  if (fs::exists(folder / "skip")) return std::cout << name << " skipped: " << slurp(folder / "skip"), 0;
  const bool is_writing = std::getenv("GOLDEN") && std::string(std::getenv("GOLDEN")) == "write";
  if (is_writing && std::getenv("CI")) return std::cerr << "GOLDEN=write is refused under CI\n", 1;

  const YAML::Node spec = YAML::LoadFile(folder / "case.yaml");
  PostContext context = support::post_context();
  for (const auto& o : spec["options"]) context.cell.controller.options[o.first.as<std::string>()] = o.second.as<std::string>();
  if (spec["orientation"]) {
    const std::string o = spec["orientation"].as<std::string>();
    context.cell.controller.orientation = o == "cba" ? BeckhoffOrientation::cba : o == "ypr" ? BeckhoffOrientation::ypr : BeckhoffOrientation::euler;
  }
  if (spec["speed_unit"].as<std::string>("") == "cm/min") context.cell.controller.speed_unit = SpeedUnit::cm_min;
  const Post* post = nullptr;
  for (const Post& p : posts())
    if (name_of(p.language) == spec["language"].as<std::string>()) post = &p;
  if (!post) return std::cerr << "case.yaml: no such language\n", 1;

  const Program program = program_of(YAML::LoadFile(folder / "program.yaml"), context);
  const auto text = post->write(program, context);
  std::map<std::string, std::string> got;
  if (!text) {
    got["expected.refusal"] = support::text_of(text.error());
  } else {
    for (const ProgramFile& f : text->files) got["expected." + f.name] = f.bytes;
    const auto back = post->read(*text, context);
    if (!back) return std::cerr << name << ": the emitted text is not read back\n" << support::text_of(back.error()), 1;
    const std::string d = support::difference(program, *back, support::tolerance_of(*post, context),
                                              support::prints_in_base(*post, context));
    if (!d.empty()) return std::cerr << name << ": the emitted text says something else: " << d << "\n", 1;
    for (const Check& c : post->lint(*text, context))
      if (!c.is_passed) return std::cerr << name << ": " << c.name << " " << c.where << "\n", 1;
  }
  std::map<std::string, std::string> expected;
  for (const auto& e : fs::directory_iterator(folder))
    if (e.path().filename().string().starts_with("expected.")) expected[e.path().filename().string()] = slurp(e.path());
  if (got == expected) return 0;
  if (is_writing) {
    for (const auto& [f, bytes] : expected) fs::remove(folder / f);
    for (const auto& [f, bytes] : got) spit(folder / f, bytes);
    return std::cout << name << " written\n", 0;
  }
  fs::remove_all(actual);
  for (const auto& [f, bytes] : got) spit(actual / f, bytes);
  std::cerr << name << " differs from " << folder.string() << "; the actual text is in " << actual.string() << "\n";
  if (text && !expected.count("expected.refusal") && !expected.empty()) {
    ProgramText was{text->language, {}};
    for (const ProgramFile& f : text->files) was.files.push_back({f.name, expected.count("expected." + f.name) ? expected["expected." + f.name] : ""});
    std::cerr << in_physical_words(*post, was, *text, context) << "\n";
  }
  std::cerr << "to accept it: GOLDEN=write ctest --test-dir build/dev -R " << name << "\n";
  return 1;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) return std::cerr << "usage: golden_post CASE_FOLDER ACTUAL_FOLDER\n", 2;
  const bool is_expected_to_fail = fs::exists(fs::path(argv[1]) / "xfail");
  try {
    const int rc = run(argv[1], argv[2]);
    return is_expected_to_fail ? rc == 0 : rc;
  } catch (const std::exception& e) {
    std::cerr << argv[1] << ": " << e.what() << "\n";
    return 1;
  }
}
