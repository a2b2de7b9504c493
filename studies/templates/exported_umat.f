      SUBROUTINE UMAT(STRESS, STATEV, DDSDDE, SSE, SPD, SCD,
     1 RPL, DDSDDT, DRPLDE, DRPLDT, STRAN, DSTRAN, TIME, DTIME, TEMP,
     2 DTEMP, PREDEF, DPRED, CMNAME, NDI, NSHR, NTENS, NSTATV, PROPS,
     3 NPROPS, COORDS, DROT, PNEWDT, CELENT, DFGRD0, DFGRD1, NOEL,
     4 NPT, LAYER, KSPT, KSTEP, KINC)
!     Solid elements (NTENS = 6; plane strain and axisymmetric: 4).
!     Order of components: 11 22 33 12 13 23. DDSDDE: tangent of the
!     Kirchhoff stress over J in the Jaumann rate{{ ", not symmetric:" if unsymmetric else "." }}
{% if unsymmetric %}
!     *USER MATERIAL, UNSYMM
{% endif %}
!     *DEPVAR {{ depvar }}
!       1: largest I1BAR - 3 so far (softening)
{% if law.prony %}
{% for b in law.prony %}
!       {{ 2 + 12 * loop.index0 }}-{{ 7 + 12 * loop.index0 }}: DEV S of branch {{ loop.index }}, {{ 8 + 12 * loop.index0 }}-{{ 13 + 12 * loop.index0 }}: its overstress
{% endfor %}
{% endif %}
{% for s in law.maxwell %}
{% set first = 2 + 12 * (law.prony | length + loop.index0) %}
!       {{ first }}-{{ first + 5 }}: C - 1 of the isochoric part,
!       {{ first + 6 }}-{{ first + 11 }}: CV - 1 of spring {{ loop.index }}
{% endfor %}
{% if law.maxwell %}
!     A spring of modulus MU in series with a dashpot adds the Kirchhoff
!     stress MU dev(FB CV**-1 FB**T); FB: isochoric part of F.
{% endif %}
!     Relaxation acts on DEV S = S - (S : C)/3 C**-1 (S: second Piola-
!     Kirchhoff stress, elastic), not on the pressure; branches add up.
!     Softening is a factor on the whole elastic stress, volume included.
      IMPLICIT NONE
      INTEGER NTENS, NSTATV, NPROPS, NDI, NSHR, NOEL, NPT, LAYER, KSPT
      INTEGER KSTEP, KINC
      CHARACTER*80 CMNAME
      DOUBLE PRECISION STRESS(NTENS), STATEV(NSTATV)
      DOUBLE PRECISION DDSDDE(NTENS, NTENS), SSE, SPD, SCD, RPL
      DOUBLE PRECISION DDSDDT(NTENS), DRPLDE(NTENS), DRPLDT
      DOUBLE PRECISION STRAN(NTENS), DSTRAN(NTENS), TIME(2), DTIME
      DOUBLE PRECISION TEMP, DTEMP, PREDEF(*), DPRED(*), PROPS(NPROPS)
      DOUBLE PRECISION COORDS(3), DROT(3, 3), PNEWDT, CELENT
      DOUBLE PRECISION DFGRD0(3, 3), DFGRD1(3, 3)
      INTEGER NB, NF
      PARAMETER (NB = {{ law.prony | length }}, NF = {{ law.fibres | length }})
      INTEGER I, J, K, L, A, B, IV(6), JV(6)
      DOUBLE PRECISION F(3, 3), FI(3, 3), DET, BB(3, 3), B2(3, 3)
      DOUBLE PRECISION I1, I2, D(6), KAPPA, T(3, 3), C(3, 3, 3, 3)
      DOUBLE PRECISION G1(3, 3), G2(3, 3), E(3, 3), SYM, BSB
      DOUBLE PRECISION X, XMAX, PHI, DPHI, R, S, H, GAIN, TD(3, 3)
      DOUBLE PRECISION Q, M(3), OVER(3, 3), V(3, 3), EQGAIN
      DOUBLE PRECISION CD(3, 3, 3, 3), R1(3, 3, 3, 3)
{% if law.maxwell %}
      DOUBLE PRECISION TSPR(6), CSPR(6, 6)
{% endif %}
      DATA IV /1, 2, 3, 1, 1, 2/
      DATA JV /1, 2, 3, 2, 3, 3/
      KAPPA = {{ volume.bulk_modulus | fortran }}
      DO I = 1, 3
        DO J = 1, 3
          F(I, J) = DFGRD1(I, J)
          E(I, J) = 0.0D0
        END DO
        E(I, I) = 1.0D0
      END DO
      CALL EQINV(F, FI, DET)
      DO I = 1, 3
        DO J = 1, 3
          BB(I, J) = 0.0D0
          DO K = 1, 3
            BB(I, J) = BB(I, J) + F(I, K)*F(J, K)
          END DO
          BB(I, J) = BB(I, J)*DET**(-2.0D0/3.0D0)
        END DO
      END DO
      I1 = BB(1, 1) + BB(2, 2) + BB(3, 3)
      I2 = I1**2
      DO I = 1, 3
        DO J = 1, 3
          B2(I, J) = 0.0D0
          DO K = 1, 3
            B2(I, J) = B2(I, J) + BB(I, K)*BB(K, J)
          END DO
        END DO
        I2 = I2 - B2(I, I)
      END DO
      I2 = I2/2.0D0
      CALL EQGAPW(I1, I2, D)
!     Kirchhoff stress T and its tangent C, elastic
      DO I = 1, 3
        DO J = 1, 3
          G1(I, J) = 2.0D0*(BB(I, J) - I1/3.0D0*E(I, J))
          G2(I, J) = I1*BB(I, J) - B2(I, J) - 2.0D0/3.0D0*I2*E(I, J)
          G2(I, J) = 2.0D0*G2(I, J)
          T(I, J) = D(2)*G1(I, J) + D(3)*G2(I, J)
          T(I, J) = T(I, J) + KAPPA*(DET - 1.0D0)*DET*E(I, J)
          V(I, J) = I1*BB(I, J) - B2(I, J)
        END DO
      END DO
      DO L = 1, 3
      DO K = 1, 3
      DO J = 1, 3
      DO I = 1, 3
        SYM = (E(I, K)*E(J, L) + E(I, L)*E(J, K))/2.0D0
        BSB = (BB(I, K)*BB(J, L) + BB(I, L)*BB(J, K))/2.0D0
        Q = D(4)*G1(I, J)*G1(K, L) + D(6)*G2(I, J)*G2(K, L)
        Q = Q + D(5)*(G1(I, J)*G2(K, L) + G2(I, J)*G1(K, L))
        R = -4.0D0/3.0D0*(BB(I, J)*E(K, L) + E(I, J)*BB(K, L))
        R = R + I1*(4.0D0/9.0D0*E(I, J)*E(K, L) + 4.0D0/3.0D0*SYM)
        Q = Q + D(2)*R
        R1(I, J, K, L) = R
        R = 4.0D0*(BB(I, J)*BB(K, L) - BSB)
        R = R - 8.0D0/3.0D0*(E(I, J)*V(K, L) + V(I, J)*E(K, L))
        R = R + I2*(16.0D0/9.0D0*E(I, J)*E(K, L) + 8.0D0/3.0D0*SYM)
        Q = Q + D(3)*R
        R = DET**2*E(I, J)*E(K, L)
        R = R + (DET - 1.0D0)*DET*(E(I, J)*E(K, L) - 2.0D0*SYM)
        C(I, J, K, L) = Q + KAPPA*R
      END DO
      END DO
      END DO
      END DO
      SSE = D(1) + KAPPA/2.0D0*(DET - 1.0D0)**2
{% for f in law.fibres %}
!     fibres: k = {{ f.k }}, k2 = {{ f.k2 }},
!     kappa = {{ f.kappa }}, about this unit vector
      M(1) = {{ cosines[loop.index0][0] | fortran }}
      M(2) = {{ cosines[loop.index0][1] | fortran }}
      M(3) = 0.0D0
      H = {{ f.k | fortran }}
      S = {{ f.k2 | fortran }}
      R = {{ f.d | fortran }}
      CALL EQFIBR(H, S, R, M, F, I1, G1, R1, T, C, SSE)
{% endfor %}
      X = MAX(I1 - 3.0D0, 0.0D0)
      XMAX = MAX(STATEV(1), X)
      STATEV(1) = XMAX
      PHI = 1.0D0
      DPHI = 0.0D0
{% if law.mullins %}
      R = {{ law.mullins[0] | fortran }}
      S = {{ law.mullins[1] | fortran }}
      H = {{ law.mullins[2] | fortran }}
      R = R/ERF(1.0D0/H)
      S = S + H*MAX(XMAX, 1.0D-9)
      Q = 1.0D0 - R*ERF((XMAX - X)/S)
      H = 0.0D0
      IF (X .LT. XMAX) H = EXP(-((XMAX - X)/S)**2)/S
      H = H*R*2.0D0/SQRT(ACOS(-1.0D0))
      DPHI = DPHI*Q + PHI*H
      PHI = PHI*Q
{% endif %}
{% if law.payne %}
      R = {{ law.payne[0] | fortran }}
      H = {{ law.payne[1] | fortran }}
      Q = 1.0D0 + R*EXP(-XMAX/H)
      H = -R*EXP(-XMAX/H)/H
      IF (X .LT. XMAX) H = 0.0D0
      DPHI = DPHI*Q + PHI*H
      PHI = PHI*Q
{% endif %}
      DO L = 1, 3
      DO K = 1, 3
      DO J = 1, 3
      DO I = 1, 3
        Q = PHI*C(I, J, K, L) + DPHI*T(I, J)*G1(K, L)
        C(I, J, K, L) = Q
      END DO
      END DO
      END DO
      END DO
      DO I = 1, 3
        DO J = 1, 3
          T(I, J) = PHI*T(I, J)
        END DO
      END DO
{% if law.prony %}
      CALL EQDEV(T, C, TD, CD)
{% endif %}
{% for b in law.prony %}
!     branch {{ loop.index }}: g = {{ b.g }}, tau = {{ b.tau }} s
      R = DTIME/{{ b.tau | fortran }}
      GAIN = 1.0D0
      IF (R .GT. 1.0D-12) GAIN = EQGAIN(R)
      DO A = 1, 6
        H = 0.0D0
        DO K = 1, 3
          DO L = 1, 3
            H = H + FI(IV(A), K)*TD(K, L)*FI(JV(A), L)
          END DO
        END DO
        K = {{ 7 + 12 * loop.index0 }} + A
        Q = EXP(-R)*STATEV(K) - GAIN*STATEV(K - 6)
        STATEV(K) = Q + GAIN*H
        STATEV(K - 6) = H
        OVER(IV(A), JV(A)) = {{ b.g | fortran }}*Q
        OVER(JV(A), IV(A)) = OVER(IV(A), JV(A))
      END DO
      GAIN = {{ b.g | fortran }}*GAIN
      DO J = 1, 3
      DO I = 1, 3
        T(I, J) = T(I, J) + GAIN*TD(I, J)
        DO K = 1, 3
          DO L = 1, 3
            T(I, J) = T(I, J) + F(I, K)*OVER(K, L)*F(J, L)
            C(I, J, K, L) = C(I, J, K, L) + GAIN*CD(I, J, K, L)
          END DO
        END DO
      END DO
      END DO
{% endfor %}
{% if law.maxwell %}
      DO A = 1, 6
        TSPR(A) = 0.0D0
        DO B = 1, 6
          CSPR(A, B) = 0.0D0
        END DO
      END DO
{% endif %}
{% for s in law.maxwell %}
!     spring {{ loop.index }}: mu = {{ s.mu }}, tau = {{ s.tau }} s
      R = {{ s.mu | fortran }}
      H = {{ s.tau | fortran }}
      CALL EQSPRG(R, DTIME/H, F, STATEV({{ 2 + 12 * (law.prony | length + loop.index0) }}), TSPR, CSPR)
{% endfor %}
      DO A = 1, NTENS
        I = IV(A)
        J = JV(A)
        STRESS(A) = T(I, J)/DET
        DO B = 1, NTENS
          K = IV(B)
          L = JV(B)
          Q = E(I, K)*T(J, L) + E(J, L)*T(I, K)
          Q = (Q + E(I, L)*T(J, K) + E(J, K)*T(I, L))/2.0D0
          Q = Q + C(I, J, K, L)
          DDSDDE(A, B) = Q/DET
        END DO
      END DO
{% if law.maxwell %}
      DO A = 1, NTENS
        STRESS(A) = STRESS(A) + TSPR(A)/DET
        DO B = 1, NTENS
          DDSDDE(A, B) = DDSDDE(A, B) + CSPR(A, B)/DET
        END DO
      END DO
{% endif %}
      END

      SUBROUTINE EQINV(F, FI, DET)
!     inverse and determinant
      IMPLICIT NONE
      DOUBLE PRECISION F(3, 3), FI(3, 3), DET
      INTEGER I, J, I1, I2, J1, J2
      DO I = 1, 3
        DO J = 1, 3
          I1 = MOD(I, 3) + 1
          I2 = MOD(I + 1, 3) + 1
          J1 = MOD(J, 3) + 1
          J2 = MOD(J + 1, 3) + 1
          FI(J, I) = F(I1, J1)*F(I2, J2) - F(I1, J2)*F(I2, J1)
        END DO
      END DO
      DET = F(1, 1)*FI(1, 1) + F(1, 2)*FI(2, 1) + F(1, 3)*FI(3, 1)
      DO I = 1, 3
        DO J = 1, 3
          FI(I, J) = FI(I, J)/DET
        END DO
      END DO
      END

      SUBROUTINE EQFIBR(K, K2, D, M, F, I1, G1, R1, T, C, W)
!     adds K/(2 K2) (exp(K2 E**2) - 1), E = I4 - 1 + D (I1 - 3),
!     I4 = |F M|**2; G1, R1: derivatives of I1
      IMPLICIT NONE
      DOUBLE PRECISION K, K2, D, M(3), F(3, 3), I1, G1(3, 3)
      DOUBLE PRECISION R1(3, 3, 3, 3), T(3, 3), C(3, 3, 3, 3), W
      DOUBLE PRECISION V(3), E, G, H, P(3, 3)
      INTEGER I, J, A, B
      E = D*(I1 - 3.0D0) - 1.0D0
      DO I = 1, 3
        V(I) = F(I, 1)*M(1) + F(I, 2)*M(2) + F(I, 3)*M(3)
        E = E + V(I)**2
      END DO
      G = K2*E**2
      H = E**2*(1.0D0 + G/2.0D0)
      IF (G .GT. 1.0D-6) H = (EXP(G) - 1.0D0)/K2
      W = W + K/2.0D0*H
      H = K*EXP(G)*(1.0D0 + 2.0D0*G)
      G = K*EXP(G)*E
      DO I = 1, 3
        DO J = 1, 3
          P(I, J) = 2.0D0*V(I)*V(J) + D*G1(I, J)
          T(I, J) = T(I, J) + G*P(I, J)
        END DO
      END DO
      DO B = 1, 3
      DO A = 1, 3
      DO J = 1, 3
      DO I = 1, 3
        C(I, J, A, B) = C(I, J, A, B) + H*P(I, J)*P(A, B)
     1    + G*D*R1(I, J, A, B)
      END DO
      END DO
      END DO
      END DO
      END

      SUBROUTINE EQDEV(T, C, TD, CD)
!     Kirchhoff stress of DEV S = S - (S : C)/3 C**-1 and its tangent
      IMPLICIT NONE
      DOUBLE PRECISION T(3, 3), C(3, 3, 3, 3), TD(3, 3), CD(3, 3, 3, 3)
      DOUBLE PRECISION E(3, 3), MEAN, SYM
      INTEGER I, J, K, L
      MEAN = (T(1, 1) + T(2, 2) + T(3, 3))/3.0D0
      DO I = 1, 3
        DO J = 1, 3
          E(I, J) = 0.0D0
          IF (I .EQ. J) E(I, J) = 1.0D0
          TD(I, J) = T(I, J) - MEAN*E(I, J)
        END DO
      END DO
      DO L = 1, 3
      DO K = 1, 3
      DO J = 1, 3
      DO I = 1, 3
        SYM = (E(I, K)*E(J, L) + E(I, L)*E(J, K))/2.0D0
        CD(I, J, K, L) = C(I, J, K, L) + 2.0D0*MEAN*SYM
        CD(I, J, K, L) = CD(I, J, K, L) - E(I, J)/3.0D0
     1    *(C(1, 1, K, L) + C(2, 2, K, L) + C(3, 3, K, L))
        CD(I, J, K, L) = CD(I, J, K, L) - E(I, J)*2.0D0/3.0D0*T(K, L)
      END DO
      END DO
      END DO
      END DO
      END

      DOUBLE PRECISION FUNCTION EQGAIN(R)
!     (1 - exp(-R))/R
      IMPLICIT NONE
      DOUBLE PRECISION R
      EQGAIN = (1.0D0 - EXP(-R))/R
      IF (R .LT. 1.0D-5) EQGAIN = 1.0D0 - R/2.0D0 + R*R/6.0D0
      END
{% if law.maxwell %}

      SUBROUTINE EQSPRG(MU, R, F, STATE, T, C)
!     Adds the Kirchhoff stress T of a spring of modulus MU after R
!     relaxation times and its tangent C by imaginary steps, which are
!     exact; STATE: C - 1 and CV - 1, before and after.
      IMPLICIT NONE
      DOUBLE PRECISION MU, R, F(3, 3), STATE(12), T(6), C(6, 6), TINY
      PARAMETER (TINY = 1.0D-30)
      COMPLEX*16 G(3, 3), E(3, 3), TAU(6), NEW(12)
      INTEGER A, B, I, J, K, IV(6), JV(6)
      DATA IV /1, 2, 3, 1, 1, 2/
      DATA JV /1, 2, 3, 2, 3, 3/
      DO B = 0, 6
        DO I = 1, 3
          DO J = 1, 3
            E(I, J) = (0.0D0, 0.0D0)
          END DO
          E(I, I) = (1.0D0, 0.0D0)
        END DO
        IF (B .GT. 0) THEN
          I = IV(B)
          J = JV(B)
          E(I, J) = E(I, J) + DCMPLX(0.0D0, TINY/2.0D0)
          E(J, I) = E(J, I) + DCMPLX(0.0D0, TINY/2.0D0)
        END IF
        DO I = 1, 3
          DO J = 1, 3
            G(I, J) = (0.0D0, 0.0D0)
            DO K = 1, 3
              G(I, J) = G(I, J) + E(I, K)*F(K, J)
            END DO
          END DO
        END DO
        CALL EQFLOW(R, G, STATE, TAU, NEW)
        DO A = 1, 6
          IF (B .EQ. 0) T(A) = T(A) + MU*DBLE(TAU(A))
          IF (B .GT. 0) C(A, B) = C(A, B) + MU*DIMAG(TAU(A))/TINY
        END DO
      END DO
!     the last step was imaginary, so that real parts are the state
      DO A = 1, 12
        STATE(A) = DBLE(NEW(A))
      END DO
      END

      SUBROUTINE EQFLOW(R, F, STATE, TAU, NEW)
!     TAU of unit modulus and the new state: TAU_R dCV/dt =
!     C - (C : CV**-1)/3 CV, C linear in time, in four parts
      IMPLICIT NONE
      DOUBLE PRECISION R, STATE(12)
      COMPLEX*16 F(3, 3), TAU(6), NEW(12), C(6), V(6), W(6), DET, P
      COMPLEX*16 S(6), D(6), RATE, X, DECAY, GAIN, MEAN
      INTEGER A, I, J, K, L, N, IV(6), JV(6)
      DATA IV /1, 2, 3, 1, 1, 2/
      DATA JV /1, 2, 3, 2, 3, 3/
      DET = F(1, 1)*(F(2, 2)*F(3, 3) - F(2, 3)*F(3, 2))
      DET = DET - F(1, 2)*(F(2, 1)*F(3, 3) - F(2, 3)*F(3, 1))
      DET = DET + F(1, 3)*(F(2, 1)*F(3, 2) - F(2, 2)*F(3, 1))
      P = EXP(-2.0D0/3.0D0*LOG(DET))
      DO A = 1, 6
        C(A) = (0.0D0, 0.0D0)
        DO K = 1, 3
          C(A) = C(A) + P*F(K, IV(A))*F(K, JV(A))
        END DO
        S(A) = STATE(A)
        V(A) = STATE(6 + A)
        IF (A .LE. 3) S(A) = S(A) + 1.0D0
        IF (A .LE. 3) V(A) = V(A) + 1.0D0
        D(A) = (C(A) - S(A))/4.0D0
      END DO
      DO N = 1, 4
        CALL EQSYM(V, W, DET)
        RATE = (0.0D0, 0.0D0)
        DO A = 1, 6
          X = (S(A) + D(A)/2.0D0)*W(A)/3.0D0
          IF (A .GT. 3) X = 2.0D0*X
          RATE = RATE + X
        END DO
        X = RATE*R/4.0D0
        DECAY = EXP(-X)
        IF (ABS(X) .GT. 1.0D-5) THEN
          GAIN = (1.0D0 - DECAY)/X
        ELSE
          GAIN = 1.0D0 - X/2.0D0 + X*X/6.0D0
        END IF
        DO A = 1, 6
          V(A) = DECAY*V(A) + (S(A)*(1.0D0 - DECAY)
     1      + D(A)*(1.0D0 - GAIN))/RATE
          S(A) = S(A) + D(A)
        END DO
        CALL EQSYM(V, W, DET)
        X = EXP(-LOG(DET)/3.0D0)
        DO A = 1, 6
          V(A) = V(A)*X
        END DO
      END DO
      CALL EQSYM(V, W, DET)
      DO A = 1, 6
        NEW(A) = C(A)
        NEW(6 + A) = V(A)
        IF (A .LE. 3) NEW(A) = NEW(A) - 1.0D0
        IF (A .LE. 3) NEW(6 + A) = NEW(6 + A) - 1.0D0
        TAU(A) = (0.0D0, 0.0D0)
        DO K = 1, 3
          DO L = 1, 3
            J = K + L + 1
            IF (K .EQ. L) J = K
            TAU(A) = TAU(A) + P*F(IV(A), K)*W(J)*F(JV(A), L)
          END DO
        END DO
      END DO
      MEAN = (TAU(1) + TAU(2) + TAU(3))/3.0D0
      DO I = 1, 3
        TAU(I) = TAU(I) - MEAN
      END DO
      END

      SUBROUTINE EQSYM(V, W, DET)
!     inverse W and determinant of V: 11 22 33 12 13 23
      IMPLICIT NONE
      COMPLEX*16 V(6), W(6), DET
      INTEGER A
      W(1) = V(2)*V(3) - V(6)*V(6)
      W(2) = V(1)*V(3) - V(5)*V(5)
      W(3) = V(1)*V(2) - V(4)*V(4)
      W(4) = V(5)*V(6) - V(4)*V(3)
      W(5) = V(4)*V(6) - V(5)*V(2)
      W(6) = V(4)*V(5) - V(6)*V(1)
      DET = V(1)*W(1) + V(4)*W(4) + V(5)*W(5)
      DO A = 1, 6
        W(A) = W(A)/DET
      END DO
      END
{% endif %}

{% include "exported_energy.f" %}
