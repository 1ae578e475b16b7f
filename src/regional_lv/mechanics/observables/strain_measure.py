"""Which strain is reported: exponent and kind of the Seth-Hill family, along given directions.

With the right Cauchy-Green tensor C of a motion and a unit direction q of its reference state,

    tensor:  q . (C^(n/2) - 1) q / n,        line:  ((q . C q)^(n/2) - 1) / n,

and for n = 0 the limits q . ln C q / 2 and ln(q . C q) / 2 (Hill 1968, doi
10.1016/0022-5096(68)90031-8). n = 2 is Green's strain, for which both are the same, 1 the nominal
(engineering, Biot's) one, 0 the logarithmic one, -2 Almansi's. The tensor's component is what codes
report, the change of length of the material line along q is what a tracked line shows.
"""

import torch

from regional_lv.quantities.seth_hill import Measure


class StrainMeasure(Measure):
    """A `Measure` that strains are computed by."""

    def along(self, C: torch.Tensor, directions: torch.Tensor) -> torch.Tensor:
        """Strains (k, m) along unit `directions` (k, m, 3) of symmetric positive `C` (m, 3, 3)."""
        squared = torch.einsum("kmi,mij,kmj->km", directions, C, directions)
        if self.exponent == 2:
            return (squared - 1) / 2
        parts = []
        if self.line_share:
            parts.append(self.line_share * _seth_hill(squared, self.exponent))
        if self.line_share != 1:
            strain = _SymmetricFunction.apply(C, self.exponent)
            along = torch.einsum("kmi,mij,kmj->km", directions, strain, directions)
            parts.append((1 - self.line_share) * along)
        return sum(parts)


def _seth_hill(squared: torch.Tensor, n: float) -> torch.Tensor:
    """(l^n - 1) / n of squared stretches l^2; the logarithm of l for n = 0."""
    log = squared.log() / 2
    return log if n == 0 else torch.expm1(n * log) / n


class _SymmetricFunction(torch.autograd.Function):
    """The Seth-Hill function of symmetric tensors (m, 3, 3).

    The derivative is that of Daleckii and Krein, with divided differences, which stay finite where
    eigenvalues coincide (Higham 2008, Functions of Matrices, theorem 3.11).
    """

    @staticmethod
    def forward(ctx, C, n):
        values, vectors = torch.linalg.eigh(C)
        function = _seth_hill(values, n)
        ctx.save_for_backward(values, vectors, function)
        ctx.n = n
        return (vectors * function[:, None, :]) @ vectors.mT

    @staticmethod
    def backward(ctx, gradient):
        values, vectors, function = ctx.saved_tensors
        gap = values[:, :, None] - values[:, None, :]
        rise = function[:, :, None] - function[:, None, :]
        # f'(x) = x^(n/2 - 1) / 2 at the middle: correct to the square of a gap this small.
        middle = (values[:, :, None] + values[:, None, :]) / 2
        close = gap.abs() < 1e-6 * middle
        slope = 0.5 * middle ** (ctx.n / 2 - 1)
        divided = torch.where(close, slope, rise / torch.where(close, torch.ones_like(gap), gap))
        symmetric = (gradient + gradient.mT) / 2
        inner = vectors.mT @ symmetric @ vectors
        return vectors @ (divided * inner) @ vectors.mT, None
