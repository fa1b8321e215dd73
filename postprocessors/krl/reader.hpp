// SPDX-License-Identifier: GPL-3.0-or-later
// The reader of KRL: what it holds between the statements. Internal to the dialect; its parts are in read_files.cpp (modules, declarations),
// read_values.cpp (positions, frames, tools), read_statements.cpp (calls, settings), read_events.cpp (outputs, checks, triggers)
// and read_motions.cpp.
#pragma once

#include <map>
#include <set>

#include "postprocessors/krl/krl.hpp"
#include "postprocessors/reading_arm.hpp"

namespace asbuilt::krl {

using namespace reading;

using Components = std::map<std::string, double>;  // of an aggregate: X, A1, S, CP ...

struct Module {
  Line head;
  std::string name;
  std::vector<Line> body;
  std::vector<std::string> header;
};

inline bool is_comment_fold(std::string_view comment) { return comment.starts_with("FOLD") || comment.starts_with("ENDFOLD"); }

class Reader {
 public:
  Reader(const ProgramText& text, const PostContext& context) : text_(text), context_(context), build_(context) {}

  Program read();

 private:
  const ProgramText& text_;
  const PostContext& context_;
  Builder build_;
  ArmReader arm_{context_};
  std::map<std::string, Module> modules_;
  std::vector<std::string> order_;
  std::string original_name_;
  std::map<std::string, Components> names_;         // declared positions, frames, frame data
  std::set<std::string> declared_;                  // names without a value
  std::map<int, Components> base_data_;
  std::set<std::string> running_;
  Components now_;                                  // the last Cartesian target: left-out components keep their value
  std::optional<double> speed_m_s_, apo_mm_;
  std::array<std::optional<double>, 6> percent_;
  std::string fdat_;
  bool is_in_spline_ = false;
  int spline_points_ = 0;
  std::set<std::string> checked_;                   // machine values that the program waits for
  Line armed_at_;                                   // a trigger that waits for its motion
  std::vector<std::pair<Line, std::string>> at_end_of_next_;

  // files
  static std::string_view code(std::string_view text) { return text.substr(0, text.find(';')); }

  void load(const ProgramFile& f);
  void load_data(const ProgramFile& f);
  /// DECL [GLOBAL] type name [= value] [, name ...]; false where the line is no declaration.
  bool declaration(Scanner& s);
  /// {X 1.0,Y 2.0,...}; a value may be a number, an enumeration, text or a list with index.
  Components aggregate(Scanner& s);

  // values
  Components value(Scanner& s, std::string_view what);
  static double get(const Components& c, const char* key);
  template <class To>
  static Pose<To, frame::Tool> pose_of(const Components& c) {
    return {rotation_zyx(get(c, "A"), get(c, "B"), get(c, "C")), Vec3(get(c, "X"), get(c, "Y"), get(c, "Z"))};
  }
  void need_frame(const Line& line, const Components& c);
  Components base_data(const Line& line, int n);
  void set_base(const Line& line, const Components& c);
  void set_base(Scanner& s);
  static int index(Scanner& s, int lo, int hi);
  void set_tool(Scanner& s);

  // statements
  void run(const Module& m);
  void statement(Scanner& s);
  /// A call of one of the machine's own sub-programs that switch something: ARC_START(3), LOG_START( ).
  bool equipment(Scanner& s);
  std::optional<int> coolant() const;
  void basic(Scanner& s);
  double reference(Scanner& s);
  /// A check of which controller this is: it must be the cell's.
  void machine_check(const Line& line, const std::string& key, const std::string& text);
  void wait(Scanner& s);
  bool output(Scanner& s, const Line& line);
  /// What a trigger does: an output, or one of the machine's sub-programs.
  void action(Scanner& s, const Line& line);
  void trigger(Scanner& s);
  void moved();
  bool setting(Scanner& s);
  void positive(Scanner& s);

  // motions
  void joint(Scanner& s);
  /// PTP to a frame: the joint values by status and turn. T holds the signs of all axes; of S the sign of A5 (bit 2) is used, which
  /// documents agree about; where signs and limits leave two postures the target is refused.
  std::array<double, 6> posture(const Line& line, const Components& c);
  Components cartesian(Scanner& s);
  void path(Scanner& s, bool is_arc, bool is_spline);
};

}  // namespace asbuilt::krl
