// SPDX-License-Identifier: GPL-3.0-or-later
// The lint rules I-01 to I-17 of INFORM, on the text alone and without the reader's grammar; G-.. rules through the reader.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <set>

#include "postprocessors/inform/inform.hpp"
#include "postprocessors/inform/posture.hpp"
#include "postprocessors/linting.hpp"

namespace asbuilt::inform {
namespace {

using namespace linting;
using reading::Line;

std::string_view code_of(std::string_view line) {
  return line.starts_with("'") || line.starts_with("//NAME") || line.starts_with("///DATE") || line.starts_with("///COMM") ? std::string_view() : line;
}
int decimals(std::string_view number) {
  const std::size_t dot = number.find('.');
  return dot == std::string_view::npos ? 0 : static_cast<int>(number.size() - dot - 1);
}
std::vector<std::string_view> fields(std::string_view text) {
  std::vector<std::string_view> out;
  for (;;) {
    const std::size_t n = text.find(',');
    out.push_back(text.substr(0, n));
    if (n == std::string_view::npos) return out;
    text.remove_prefix(n + 1);
  }
}

struct Linter {
  Findings& f;
  const PostContext& context;
  std::set<std::string> jobs, called;
  std::set<int> user_frames;
  std::string first_motion_job;
  bool has_moved = false, is_spindle_on = false;
  double analog = 0;                  // volts for the spindle's speed
  std::optional<JointVector> q_last;  // of the last pulses
  std::map<std::string, JointVector> pulses;     // of this job's positions
  std::optional<JointVector> q_run;              // where the joint moves of the jobs so far end
  std::map<std::string, JointVector> q_at_call;  // where the arm stands when a job is called

  bool has_option(const char* key) const { return context.cell.controller.options.count(key) > 0; }

  void job(const ProgramFile& file) {
    const auto lines = raw_lines(file);
    if (lines.empty() || lines[0].text != "/JOB") f.add("I-01", file.name + ":1", "the first line is not /JOB");
    if (!file.bytes.ends_with("END\r\n")) f.add("I-01", file.name, "the last line is not END with CR LF");
    for (std::size_t i = 0; i < file.bytes.size(); ++i)
      if (file.bytes[i] == '\n' && (i == 0 || file.bytes[i - 1] != '\r')) {
        f.add("I-01", file.name, "a line ends without CR");
        break;
      }
    if (lines.size() > 9999) f.add("I-15", file.name, std::to_string(lines.size()) + " lines");

    int section = 0;  // 1 //NAME, 2 //POS, 3 ///NPOS, 4 positions, 5 //INST, 6 attributes, 7 NOP
    int counted = -1, found = 0, used = 0, nops = 0, ends = 0, arc_run = 0;
    std::string type, name;
    bool is_rectan = false, has_rconf = false, has_user = false, has_tool = false, has_rj = false, has_frame = false, is_arc_on = false, is_weaving = false;
    std::string last_motion;
    for (const Line& line : lines) {
      const auto step = [&](int s) {
        if (s <= section && !(s == 4 || s == 6)) f.add("I-02", line, "twice or in the wrong order");
        if (s < section) f.add("I-02", line, "in the wrong order");
        section = std::max(section, s);
      };
      if (line.text.starts_with("'")) {
        if (line.text.size() > 33) f.add("I-11", line, "a comment longer than 32 characters");
        continue;
      }
      if (line.text.starts_with("//NAME")) {
        step(1);
        name = std::string(line.text.substr(std::min<std::size_t>(7, line.text.size())));
        const std::size_t longest = has_option("inform.name_length") ? std::strtoul(context.cell.controller.options.at("inform.name_length").c_str(), nullptr, 10) : 32;
        if (name.size() > longest || name.empty()) f.add("I-02", line, "the job name is empty or too long");
        for (char c : name)
          if (!((c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-')) f.add("I-02", line, "a character outside A-Z 0-9 _ -");
        if (stem_of(file.name) != name) f.add("I-02", line, "the job is not called like its file");
        if (!jobs.insert(name).second) f.add("I-02", line, "two jobs of one name");
        if (const auto at = q_at_call.find(name); at != q_at_call.end()) q_last = at->second;  // a relative job begins where its caller stands
        pulses.clear();
        continue;
      }
      if (line.text.starts_with("///DATE")) {
        step(6);
        std::string wanted = context.date.substr(0, 10);
        for (char& c : wanted)
          if (c == '-') c = '/';
        if (line.text.find(wanted) == std::string_view::npos) f.add("I-17", line, "another date than the one given");
        continue;
      }
      const auto t = tokens_of(code_of(line.text));
      if (t.empty()) continue;
      if (line.text == "//POS") { step(2); continue; }
      if (line.text == "//INST") { step(5); continue; }
      const bool is_head = line.text.starts_with("///");
      const std::string word = is_head && t.size() > 3 ? t[3].text : t[0].text;
      const std::string_view rest = line.text.substr(std::min(line.text.size(), line.text.find(' ') == std::string_view::npos ? line.text.size() : line.text.find(' ') + 1));
      if (is_head) {
        if (word == "NPOS") {
          step(3);
          const auto v = fields(rest);
          counted = std::atoi(std::string(v[0]).c_str());
          if (v.size() != 6) f.add("I-03", line, "///NPOS has six counts");
        } else if (word == "TOOL") {
          step(4), has_tool = true;
          const int n = std::atoi(std::string(rest).c_str());
          bool is_known = false;
          for (const ToolSpec& tool : context.cell.tools) is_known |= tool.number == n;
          if (n < 0 || n > 63 || !is_known) f.add("I-06", line, "the tool is not in the cell");
        } else if (word == "USER") {
          step(4), has_user = true;
          const int n = std::atoi(std::string(rest).c_str());
          if (n < 1 || n > 63 || !user_frames.count(n)) f.add("I-06", line, "the user frame is not in UFRAME.CND");
        } else if (word == "POSTYPE") {
          step(4), type = std::string(rest), is_rectan = has_rconf = false;
          if (type == "USER" && !has_user) f.add("I-06", line, "POSTYPE USER before ///USER");
        } else if (word == "PULSE") {
          step(4);
          if (!context.cell.controller.pulses_per_degree) f.add("I-10", line, "no table of pulses per degree");
        } else if (word == "RECTAN") {
          step(4), is_rectan = true;
          if (type == "PULSE" || type.empty()) f.add("I-05", line, "RECTAN without a Cartesian POSTYPE");
        } else if (word == "RCONF") {
          step(4), has_rconf = true;
          const auto v = fields(rest);
          if (v.size() != 24 && (v.size() < 6 || v.size() > 8)) f.add("I-05", line, "the number of RCONF flags");
          for (std::string_view flag : v)
            if (flag != "0" && flag != "1") f.add("I-05", line, "an RCONF flag other than 0 and 1");
          if (!is_rectan) f.add("I-05", line, "RCONF without RECTAN");
          posture(line, v);
        } else if (word == "COMM") {
          step(6);
          if (rest.size() > 32) f.add("I-17", line, "a job comment longer than 32 characters");
        } else if (word == "ATTR") {
          step(6);
          for (std::string_view a : fields(rest)) has_rj |= a == "RJ";
          if (has_rj && !(has_option("inform.relative") && context.cell.controller.options.at("inform.relative") == "yes"))
            f.add("I-07", line, "a relative job (RJ), an option that the machine file does not name (inform.relative: yes)");
        } else if (word == "FRAME") {
          step(6), has_frame = true;
        } else if (word == "GROUP1" || word == "LVARS" || word == "FOLDERNAME") {
          if (word == "GROUP1") step(6);
        } else {
          f.add("I-02", line, "an unknown head line");
        }
        continue;
      }
      if (section < 5 && t.size() > 2 && t[1].is("=")) {
        step(4);
        position(line, t, found, type, is_rectan, has_rconf, has_tool);
        continue;
      }
      if (section < 5) continue;
      section = std::max(section, 6);
      instruction(line, t, nops, ends, used, arc_run, is_arc_on, is_weaving, last_motion);
    }
    const std::string where = file.name;
    if (counted != found) f.add("I-03", where, "///NPOS says " + std::to_string(counted) + ", there are " + std::to_string(found));
    if (used != found) f.add("I-03", where, std::to_string(found - used) + " positions are not used");
    if (nops != 1 || ends != 1) f.add("I-11", where, "NOP and END stand once each");
    if (has_rj != has_frame) f.add("I-07", where, "RJ and ///FRAME belong together");
    if (is_arc_on || is_weaving) f.add("I-13", where, "an arc or a weave is not ended");
    close_run(where, arc_run);
  }

  /// The flags must be those of the joint target before: a path does not change the arm's form.
  void posture(const Line& line, const std::vector<std::string_view>& flags) {
    if (!q_last || flags.size() != 24) return;
    const bool is_b = has_option("inform.flip") && context.cell.controller.options.at("inform.flip") == "b_axis";
    const Posture p = posture_of(context.cell.robot, *q_last, is_b ? FlipRule::b_axis : FlipRule::r_axis);
    const std::array<bool, 6> wanted = {p.is_no_flip, p.is_lower_arm, p.is_rear, p.is_r_beyond, p.is_t_beyond, p.is_s_beyond};
    for (std::size_t i = 0; i < 24; ++i)
      if ((flags[i] == "1") != (i < 6 && wanted[i])) f.add("I-05", line, "flag " + std::to_string(i + 1) + " is not that of the joint target before");
  }

  int spline_run = 0;
  /// Jobs of the controller that the machine file names.
  bool is_machines(const std::string& name) const {
    for (const char* key : {"inform.recording", "inform.tool_check"})
      if (has_option(key))
        for (const std::string& word : reading::words(context.cell.controller.options.at(key)))
          if (word == name) return true;
    return false;
  }
  bool is_listed(const char* key, double n) const {
    if (has_option(key))
      for (const std::string& word : reading::words(context.cell.controller.options.at(key)))
        if (std::atof(word.c_str()) == n) return true;
    return false;
  }
  void close_run(const std::string& where, int& arc_run) {
    if (arc_run == 1 || (arc_run > 0 && arc_run % 2 == 0)) f.add("I-09", where, "a run of MOVC needs start, middle and end");
    arc_run = 0;
  }

  void position(const Line& line, const std::vector<Token>& t, int& found, const std::string& type, bool is_rectan, bool has_rconf, bool has_tool) {
    char expected[16];
    std::snprintf(expected, sizeof expected, "C%05d", found++);
    if (!t[0].is(expected)) f.add("I-03", line, std::string("expected ") + expected);
    if (!has_tool) f.add("I-06", line, "a position before ///TOOL");
    const auto v = fields(line.text.substr(line.text.find('=') + 1));
    if (v.size() != 6 && v.size() != 7) f.add("I-04", line, "a position has six values, or seven");
    if (type == "PULSE") {
      if (v.size() >= 6 && context.cell.controller.pulses_per_degree) {
        q_last.emplace();
        for (std::size_t i = 0; i < 6; ++i) (*q_last)[i] = rad_from_deg(std::atof(std::string(v[i]).c_str()) / (*context.cell.controller.pulses_per_degree)[i]);
        pulses[t[0].text] = *q_last;
      }
      for (std::size_t i = 0; i < v.size(); ++i) {
        if (v[i].find_first_not_of("-0123456789") != std::string_view::npos || v[i].empty()) f.add("I-04", line, "pulses are whole numbers");
        else if (i < 6 && context.cell.controller.pulses_per_degree) {
          const double deg = std::atof(std::string(v[i]).c_str()) / (*context.cell.controller.pulses_per_degree)[i];
          const JointSpec& j = context.cell.robot.joints[i];
          if (j.max_rad > j.min_rad && (deg < deg_from_rad(j.min_rad) - 0.002 || deg > deg_from_rad(j.max_rad) + 0.002))
            f.add("I-10", line, "axis " + std::to_string(i + 1) + " is outside its limits");
        }
      }
    } else {
      if (!is_rectan || !has_rconf) f.add("I-05", line, "a Cartesian position before RECTAN and RCONF");
      for (std::size_t i = 0; i < v.size() && i < 6; ++i)
        if (decimals(v[i]) != (i < 3 ? 3 : 4) && !(i >= 3 && decimals(v[i]) == 2)) f.add("I-04", line, "3 decimals for mm, 4 (or 2) for degrees");
    }
  }

  static bool has(const std::vector<Token>& t, std::string_view text) { return find(t, text) != std::string::npos; }
  void range(const Line& line, std::string_view rule, const std::vector<Token>& t, const char* word, double lo, double hi) {
    const auto v = number_after(t, word);
    if (v && (*v < lo || *v > hi)) f.add(rule, line, std::string(word) + " out of range");
  }

  void instruction(const Line& line, const std::vector<Token>& t, int& nops, int& ends, int& used, int& arc_run, bool& is_arc_on, bool& is_weaving,
                   std::string& last_motion) {
    static const std::set<std::string> moves = {"MOVJ", "MOVL", "MOVC", "MOVS"};
    const std::string& op = t[0].text;
    if (ends) f.add("I-11", line, "something stands after END");
    if (op == "NOP") ++nops;
    if (op == "END") {
      ++ends;
    }
    if (op == "TIMER") {
      const auto v = number_after(t, "T");
      const std::size_t i = find(t, "=");
      if (!v || *v < 0.01 || *v > 655.35 || (i != std::string::npos && i + 1 < t.size() && decimals(t[i + 1].text) > 2))
        f.add("I-12", line, "TIMER takes 0.01 to 655.35 with two decimals");
    }
    if (op == "ARCON" || op == "ARCOF") {
      if ((op == "ARCON") == is_arc_on) f.add("I-13", line, "ARCON and ARCOF alternate");
      is_arc_on = op == "ARCON";
    }
    if (op == "ARCON" || op == "WVON") {
      const auto n = number_after(t, op == "ARCON" ? "ASF#" : "WEV#");
      if (!n || !is_listed(op == "ARCON" ? "inform.arc" : "inform.weave", *n)) f.add("I-13", line, "a condition file that the machine file does not list");
    }
    if (op == "WVON" || op == "WVOF") {
      if ((op == "WVON") == is_weaving) f.add("I-13", line, "WVON and WVOF alternate");
      is_weaving = op == "WVON";
    }
    if (op == "CALL" && t.size() > 3) {
      std::string name(line.text.substr(line.text.find(':') + 1));
      name = name.substr(0, name.find(' '));
      if (!is_machines(name)) called.insert(name);
      if (q_run) q_at_call[name] = *q_run;
    }
    for (const ToolSpec& tool : context.cell.tools) {
      if (op == "AOUT" && number_after(t, "AO#") == static_cast<double>(tool.spindle.analog)) analog = t.back().value;
      if (op == "DOUT" && number_after(t, "OT#") == static_cast<double>(tool.spindle.output)) is_spindle_on = t.back().is("ON");
    }
    if (op == "DOUT") {
      const auto n = number_after(t, "OT#");
      if (!n || *n < 1 || *n > 4096) f.add("I-16", line, "an output outside the map");
    }
    if (!moves.count(op)) return;
    if (analog != 0 && !is_spindle_on) f.add("G-10", line, "the spindle's speed is set and the spindle is not switched on");
    if (is_arc_on && (op == "MOVJ" || op == "MOVS")) f.add("I-13", line, "with the arc on only MOVL and MOVC");
    if (op == "MOVJ" && t.size() > 1 && pulses.count(t[1].text)) q_run = pulses.at(t[1].text);
    char expected[16];
    std::snprintf(expected, sizeof expected, "C%05d", used);
    if (t.size() < 2 || (t[1].text[0] == 'C' && !t[1].is(expected))) f.add("I-03", line, std::string("expected ") + expected);
    ++used;
    if (!has_moved && (op != "MOVJ" || number_after(t, "PL").value_or(-1) != 0)) f.add("I-16", line, "the first motion must be MOVJ with PL=0");
    has_moved = true;
    const bool is_cm = context.cell.controller.speed_unit == SpeedUnit::cm_min;
    if (op == "MOVJ" ? !has(t, "VJ") : !has(t, "V") && !has(t, "VR")) f.add("I-08", line, "a motion without its speed");
    range(line, "I-08", t, "VJ", 0.01, 100);
    range(line, "I-08", t, "V", 0.1, is_cm ? 9000 : 1500);
    range(line, "I-08", t, "PL", 0, 8);
    range(line, "I-08", t, "CR", 0.1, 6553.5);
    range(line, "I-08", t, "ACC", 20, 100);
    range(line, "I-08", t, "DEC", 20, 100);
    if (op == "MOVC") {
      ++arc_run;
    } else {
      close_run(reading::place(line), arc_run);
    }
    if (op == "MOVS") {
      ++spline_run;
    } else {
      if (spline_run > 0 && spline_run < 3) f.add("I-09", line, "a run of MOVS of less than three points");
      spline_run = 0;
    }
    if (has(t, "FPT") && (op != "MOVC" || arc_run < 3 || arc_run % 2 == 0)) f.add("I-09", line, "FPT belongs to the end of an arc");
    last_motion = op;
  }
};

}  // namespace

std::vector<Check> lint(const ProgramText& text, const PostContext& context) {
  Findings f(joined(kCommonErrors, {"I-01", "I-02", "I-03", "I-04", "I-05", "I-06", "I-07", "I-08", "I-09", "I-10", "I-11", "I-12", "I-13", "I-14", "I-16"}),
             joined(kCommonWarnings, {"I-15", "I-17"}));
  common_rules(f, text, context, read, code_of, true);
  Linter l{f, context, {}, {}, {}, {}};
  for (const ProgramFile& file : text.files)
    if (upper_of(file.name).ends_with(".CND"))
      for (const Line& line : raw_lines(file))
        if (line.text.starts_with("//UFRAME")) l.user_frames.insert(std::atoi(std::string(line.text.substr(8)).c_str()));
  // Pages run before the main job's end; the first motion is the first of the first page where the main job has none.
  for (const ProgramFile& file : text.files)
    if (upper_of(file.name).ends_with(".JBI")) l.job(file);
  if (l.analog != 0) f.add("G-05", text.files.front().name, "the spindle's speed is set at the end");
  for (const std::string& name : l.called)
    if (!l.jobs.count(name)) f.add("I-14", name, "is called and not delivered");
  return f.checks();
}

}  // namespace asbuilt::inform
