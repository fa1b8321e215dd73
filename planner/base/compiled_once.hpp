// SPDX-License-Identifier: GPL-3.0-or-later
// The library templates that many files use, compiled once (compiled_once.cpp) instead of in each of those files. Part of the
// precompiled headers, included nowhere else: a build without them means the same and only takes longer.
// No floating-point rule is loosened anywhere, so the numbers are the same either way.
#pragma once

#include <Eigen/Dense>
#include <nlohmann/json.hpp>
#include <string>

#ifndef ASBUILT_COMPILED_ONCE
#define ASBUILT_COMPILED_ONCE extern template
#endif

namespace asbuilt::compiled_once {

template <class M>
using Vector = Eigen::Matrix<double, M::RowsAtCompileTime, 1>;
template <class M>
using Values = typename Eigen::SelfAdjointEigenSolver<M>::RealVectorType;
template <class M>
using SubDiagonal = typename Eigen::SelfAdjointEigenSolver<M>::SubDiagonalType;
template <class M>
using Householder = typename Eigen::SelfAdjointEigenSolver<M>::TridiagonalizationType::CoeffVectorType;

using Mat2 = Eigen::Matrix2d;
using Mat3 = Eigen::Matrix3d;
using Mat4 = Eigen::Matrix4d;
using Mat6 = Eigen::Matrix<double, 6, 6>;
using MatX = Eigen::MatrixXd;

}  // namespace asbuilt::compiled_once

namespace Eigen {

#define ASBUILT_EIGENVALUES(M)                                                                                                          \
  ASBUILT_COMPILED_ONCE void internal::tridiagonalization_inplace(asbuilt::compiled_once::M&,                                           \
                                                                  asbuilt::compiled_once::Values<asbuilt::compiled_once::M>&,           \
                                                                  asbuilt::compiled_once::SubDiagonal<asbuilt::compiled_once::M>&,      \
                                                                  asbuilt::compiled_once::Householder<asbuilt::compiled_once::M>&, bool); \
  ASBUILT_COMPILED_ONCE ComputationInfo internal::computeFromTridiagonal_impl(                                                          \
      asbuilt::compiled_once::Values<asbuilt::compiled_once::M>&, asbuilt::compiled_once::SubDiagonal<asbuilt::compiled_once::M>&,      \
      const Index, bool, asbuilt::compiled_once::M&);                                                                                   \
  ASBUILT_COMPILED_ONCE SelfAdjointEigenSolver<asbuilt::compiled_once::M>&                                                              \
  SelfAdjointEigenSolver<asbuilt::compiled_once::M>::compute(const EigenBase<asbuilt::compiled_once::M>&, int);
ASBUILT_EIGENVALUES(Mat3)
ASBUILT_EIGENVALUES(Mat6)
ASBUILT_EIGENVALUES(MatX)
#undef ASBUILT_EIGENVALUES

#define ASBUILT_LDLT(M)                                                                                                                \
  ASBUILT_COMPILED_ONCE LDLT<asbuilt::compiled_once::M>& LDLT<asbuilt::compiled_once::M>::compute(                                     \
      const EigenBase<asbuilt::compiled_once::M>&);                                                                                    \
  ASBUILT_COMPILED_ONCE void LDLT<asbuilt::compiled_once::M>::_solve_impl(                                                             \
      const asbuilt::compiled_once::Vector<asbuilt::compiled_once::M>&, asbuilt::compiled_once::Vector<asbuilt::compiled_once::M>&) const;
ASBUILT_LDLT(Mat3)
ASBUILT_LDLT(Mat6)
ASBUILT_LDLT(MatX)
#undef ASBUILT_LDLT
ASBUILT_COMPILED_ONCE void LDLT<asbuilt::compiled_once::Mat6>::_solve_impl(const asbuilt::compiled_once::Mat6::IdentityReturnType&,
                                                                           asbuilt::compiled_once::Mat6&) const;
ASBUILT_COMPILED_ONCE void LDLT<asbuilt::compiled_once::MatX>::_solve_impl(const asbuilt::compiled_once::MatX&,
                                                                           asbuilt::compiled_once::MatX&) const;
ASBUILT_COMPILED_ONCE LLT<asbuilt::compiled_once::MatX>& LLT<asbuilt::compiled_once::MatX>::compute(
    const EigenBase<asbuilt::compiled_once::MatX>&);
ASBUILT_COMPILED_ONCE JacobiSVD<asbuilt::compiled_once::Mat3>& JacobiSVD<asbuilt::compiled_once::Mat3>::compute(
    const asbuilt::compiled_once::Mat3&, unsigned int);
ASBUILT_COMPILED_ONCE void PartialPivLU<asbuilt::compiled_once::Mat2>::compute();
ASBUILT_COMPILED_ONCE void PartialPivLU<asbuilt::compiled_once::Mat3>::compute();
ASBUILT_COMPILED_ONCE void PartialPivLU<asbuilt::compiled_once::Mat4>::compute();
ASBUILT_COMPILED_ONCE void ColPivHouseholderQR<asbuilt::compiled_once::MatX>::computeInPlace();

}  // namespace Eigen

namespace asbuilt::compiled_once {

using Json = nlohmann::ordered_json;
using Text = nlohmann::detail::iterator_input_adapter<std::string::const_iterator>;
using Parser = nlohmann::detail::parser<Json, Text>;

}  // namespace asbuilt::compiled_once

ASBUILT_COMPILED_ONCE class nlohmann::basic_json<nlohmann::ordered_map>;
ASBUILT_COMPILED_ONCE class nlohmann::detail::serializer<asbuilt::compiled_once::Json>;
ASBUILT_COMPILED_ONCE class nlohmann::detail::lexer<asbuilt::compiled_once::Json, asbuilt::compiled_once::Text>;
ASBUILT_COMPILED_ONCE class nlohmann::detail::json_sax_dom_parser<asbuilt::compiled_once::Json>;
ASBUILT_COMPILED_ONCE class nlohmann::detail::json_sax_dom_callback_parser<asbuilt::compiled_once::Json>;
ASBUILT_COMPILED_ONCE class nlohmann::detail::parser<asbuilt::compiled_once::Json, asbuilt::compiled_once::Text>;
ASBUILT_COMPILED_ONCE bool asbuilt::compiled_once::Parser::sax_parse_internal(
    nlohmann::detail::json_sax_dom_parser<asbuilt::compiled_once::Json>*);
ASBUILT_COMPILED_ONCE bool asbuilt::compiled_once::Parser::sax_parse_internal(
    nlohmann::detail::json_sax_dom_callback_parser<asbuilt::compiled_once::Json>*);
