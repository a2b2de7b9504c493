      SUBROUTINE UHYPER(BI1, BI2, AJ, U, UI1, UI2, UI3, TEMP, NOEL,
     1 CMNAME, INCMPFLAG, NUMSTATEV, STATEV, NUMFIELDV, FIELDV,
     2 FIELDVINC, NUMPROPS, PROPS)
!     U(BI1, BI2, AJ) = W + KAPPA/2 (AJ - 1)**2; incompressible: W
      IMPLICIT NONE
      CHARACTER*80 CMNAME
      INTEGER NOEL, INCMPFLAG, NUMSTATEV, NUMFIELDV, NUMPROPS, K
      DOUBLE PRECISION BI1, BI2, AJ, U(2), UI1(3), UI2(6), UI3(6), TEMP
      DOUBLE PRECISION STATEV(*), FIELDV(*), FIELDVINC(*), PROPS(*)
      DOUBLE PRECISION D(6), KAPPA
      KAPPA = {{ volume.bulk_modulus | fortran }}
      CALL EQGAPW(BI1, BI2, D)
      DO K = 1, 6
        UI2(K) = 0.0D0
        UI3(K) = 0.0D0
      END DO
      U(1) = D(1)
      U(2) = D(1)
      UI1(1) = D(2)
      UI1(2) = D(3)
      UI1(3) = 0.0D0
      UI2(1) = D(4)
      UI2(2) = D(6)
      UI2(4) = D(5)
      IF (INCMPFLAG .EQ. 0) THEN
        U(1) = U(1) + KAPPA/2.0D0*(AJ - 1.0D0)**2
        UI1(3) = KAPPA*(AJ - 1.0D0)
        UI2(3) = KAPPA
      END IF
      END

{% include "exported_energy.f" %}
