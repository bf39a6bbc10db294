% The design problem on a grid of frequencies in GNU Octave, dimensionless, written down once more from DESIGN section 1.
% given.m has the numbers; prints seconds, whether it says that it converged, iterations, and the point.
1;
given;
global P
P = struct ("device", device, "fixed", fixed, "index", index, "scale", scale, "weights", weights, "demands", demands,
            "integrator", integrator, "low", low', "high", high');
P.ratio = logspace (log10 (band(1)), log10 (band(2)), count);
P.below = logspace (log10 (min (felt(1), 1e-3 * pi)), log10 (pi), count);
P.nodes = logspace (log10 (felt(1)), log10 (felt(2)), 129);
P.simpson = [1, repmat([4 2], 1, 63), 4, 1] / 384;

function x = values_of (z)
  global P
  x = P.fixed;
  for k = 1:numel (P.index)
    if P.scale(k) > 0
      x(P.index(k)) = P.scale(k) * expm1 (z(k));
    else
      x(P.index(k)) = exp (z(k));
    end
  end
end

function [Z_d, C] = loop (x, w)
  global P
  s = 1i * w;
  T = P.device(3);
  if P.device(5)
    H = (1 - exp (-s * T)) ./ (s * T);
  else
    H = 2 ./ (2 + s * T);
  end
  Z_d = P.device(1) * s + P.device(2);
  C = (x(1) + P.integrator * x(2) ./ s) .* H .* exp (-s * P.device(4));
end

function Z_c = coupling (x, w)
  s = 1i * w;
  Z_c = x(5) + x(3) * x(4) * s ./ (x(3) + x(4) * s);
end

function f = objective (z)
  global P
  x = values_of (z);
  [Z_d, C] = loop (x, P.nodes);
  D = Z_d + C;
  e2 = P.weights(1)^2 ./ abs (D).^2 + P.weights(2)^2 * abs (Z_d ./ D).^2 + P.weights(3)^2 * abs (coupling (x, P.nodes)).^2;
  f = log (sum (P.simpson .* e2)) / 2;
end

function g = margins (z)
  global P
  x = values_of (z);
  [Z_d, C] = loop (x, P.ratio);
  D = Z_d + C;
  S = Z_d ./ D;
  q = C ./ D;
  excess = imag (S).^2 ./ (abs (q) + real (q));
  plain = abs (q) - real (q);
  excess(real (q) <= 0) = plain(real (q) <= 0);
  R = excess ./ (2 * real (1 ./ D));
  ratio = real (coupling (x, P.ratio)) ./ max (R, 1e-300);
  ratio(real (1 ./ D) <= 0) = 1e-3;
  [Z_d, C] = loop (x, P.below);
  loud = abs (Z_d ./ (Z_d + C));
  g = [log(ratio / P.demands(1)), log(P.demands(2) ./ loud)]' - P.demands(3);
end

function f = penalised (z, weight)
  global P
  f = objective (z) + weight * (sum (min (margins (z), 0).^2) + sum (min (z - P.low, 0).^2) + sum (min (P.high - z, 0).^2));
  if ! isfinite (f)
    f = 1e10;
  end
end

began = cputime ();
if strcmp (method, "sqp")
  [z, obj, info, rounds] = sqp (guess', @objective, [], @margins, low', high', 100, 1e-8);
  good = info == 101 || info == 104;
else
  z = guess';
  rounds = 0;
  for weight = penalties
    [z, obj, info, out] = fminunc (@(z) penalised (z, weight), z, optimset ("TolX", 1e-8, "TolFun", 1e-10, "MaxIter", 100));
    rounds += out.iterations;
  end
  good = info > 0;
end
printf ("%.17g ", cputime () - began, good, rounds, z);
